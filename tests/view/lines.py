"""Lines of a walk that was never walked, as `fg-nav stream` prints them."""

import json
import math


def now(number, east, north, t=None, field="quasi-static", sigma=0.1, continues=False, floor=0, **judged):
    return json.dumps(
        {
            "kind": "now",
            "stance": number,
            "continues": continues,
            "t": float(number) if t is None else t,
            "position_m": [east, north, 0.1 * number],
            "heading_deg": 90.0,
            "position_sigma_m": [sigma, 2 * sigma, 0.05],
            "east_north_cov_m2": 0.5 * sigma**2,
            "heading_sigma_deg": 1.5,
            "floor": floor,
            "gyro_bias_deg_s": [0.0, 0.0, 0.0],
            "gyro_bias_sigma_deg_s": [0.01, 0.01, 0.01],
            "field": field,
            "field_reason": "as asked",
            **{"verdict": "trusted", "reasons": [], **judged},
        }
    )


def circle(count, radius=5.0):
    """Lines round a circle, from the origin on."""
    angles = [2 * math.pi * k / 40 for k in range(count)]
    return [now(k, radius * (1 - math.cos(a)), radius * math.sin(a)) for k, a in enumerate(angles)]


def status(t, position, **more):
    known = {
        "standing": False,
        "heading_deg": 90.0,
        "floor": 1,
        "returns": [],
        "latency_ms": 7.5,
        "rate_hz": 400.0,
        "source": "ok",
    }
    return {"t": t, "position_m": position, **known, **more}
