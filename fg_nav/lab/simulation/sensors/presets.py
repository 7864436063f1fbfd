"""Sensors by name: what their data sheets, the papers and our own recordings say of them, field by field.

===================== ======= ==============================================================================
`ideal`               200 Hz  no errors at all, for tests of physics
`demo`                200 Hz  an industrial MEMS unit in the small: white noise and constant biases
`mpu-9250`            400 Hz  one MPU-9250 as its owner would use it: calibrated as far as one can without a turntable
`mpu-9250-raw`        400 Hz  the same as it comes out of the bag
`mpu-9250-shoe`       400 Hz  `mpu-9250` in a shoe whose iron may be anything that was found in real ones
`mpu-9250x8`          400 Hz  eight of them averaged: the module of Ma et al. 2018
`xsens-mtw`           100 Hz  the MTw of Munoz Diaz et al. 2017 and of Zhang et al. 2017
`lord-gx5`            200 Hz  the 3DM-GX5-25 of the gdin walks and of PyShoe
`lord-gx5-900`        200 Hz  the same with the range of 900 deg/s, which a brisk foot needs
`kvh-1750`            100 Hz  fibre-optic gyroscopes, MEMS accelerometers, no magnetometer
`munoz-diaz-table-2`  100 Hz  Munoz Diaz's emulated MEMS sensor: 1750 with added errors, emulated magnetometer
`munoz-diaz-table-3`  100 Hz  the one MTw of the same paper's second walk, its biases going as measured there
===================== ======= ==============================================================================

How a figure becomes a spread: where a sheet gives limits (+-3 %), half of them is the standard deviation, since
sheets of consumer parts print such limits as typical. Noise densities of sheets are one-sided and divided by
sqrt(2). "sheet" is a data sheet we could read, "memory" one that we could not look up again, "assumed" our own
choice, with its reason.

What is calibrated. As it comes out of the bag (`mpu-9250-raw`) an MPU-9250 reads up to 5 deg/s at rest, weighs
gravity 3 per cent wrong and takes 100 degrees for 103: no use for navigation. `mpu-9250` was calibrated as one can
without a turntable. Six positions on a table show the accelerometers' errors, the gyroscopes' offset and, by its change
with gravity, their g-sensitivity; ten full turns by hand about each axis, against a straight edge, show their scale
and cross-axis errors. What is left is what changes with temperature since, and how squarely a box can be held;
removing the rest of the bias is the estimator's business.

How Ma's module was calibrated is not printed, and it decides the drift of a filter without a magnetometer. Eight raw
units averaged end three loops some 45 degrees off, calibrated ones about 10 (measured on the
scenario `office`); Figure 10a of the paper ends 14 degrees off. So we take it that the module was calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from fg_nav.errors import SimulationError
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.sensors.clock import ClockPrior
from fg_nav.lab.simulation.sensors.magnetometer import IronPrior, MagnetometerPrior
from fg_nav.lab.simulation.sensors.sensor import SensorPrior
from fg_nav.lab.simulation.sensors.triad import Drift, TriadPrior

_DEG = math.radians(1.0)
_DEG_H = _DEG / 3600
_MG = 1e-3 * GRAVITY_M_S2
_ONE_SIDED = math.sqrt(0.5)

_CRYSTAL = ClockPrior(scale_sd=30e-6)
"""Assumed: quartz crystals are sold as good to 20 to 50 ppm. Samples stored on the board have even stamps."""


def preset(name: str) -> SensorPrior:
    """Prior of a sensor by name; the names are in `PRESETS`.

    Raises `SimulationError` if there is no such sensor.
    """
    if name not in PRESETS:
        raise SimulationError(f"there is no sensor '{name}': take one of {', '.join(PRESETS)}.")
    return PRESETS[name]()


def _ideal() -> SensorPrior:
    return SensorPrior("ideal", rate_hz=200.0)


def _demo() -> SensorPrior:
    """Assumed, as the small demonstration had it: 0.03 m/s^2, 0.1 deg/s and 0.3 uT a sample at 200 Hz, in a shoe."""
    rate_hz = 200.0
    return SensorPrior(
        "demo",
        rate_hz=rate_hz,
        gyr=TriadPrior(noise_density=0.1 * _DEG / math.sqrt(rate_hz), bias_sd=0.1 * _DEG),
        acc=TriadPrior(noise_density=0.03 / math.sqrt(rate_hz), bias_sd=0.02),
        mag=MagnetometerPrior(rate_hz=rate_hz, noise_sd_uT=0.3),
        iron=IronPrior(hard_sd_uT=3.5),  # measured: |h| of a real shoe, median (`_REAL_SHOES`)
    )


def _mpu_9250() -> SensorPrior:
    """Sheet: InvenSense PS-MPU-9250A-01 rev. 1.0 (2014), Tables 1 and 2; AKM MS1356-E-02 (2013) for the AK8963."""
    gyr = TriadPrior(
        noise_density=0.01 * _DEG * _ONE_SIDED,  # sheet: 0.01 deg/s/sqrt(Hz), 0.1 deg/s rms over 92 Hz
        # sheet: +-30 deg/s over the 62 K to either end, so 0.24 deg/s/K; assumed: 2 K since the bench
        bias_sd=0.5 * _DEG,
        # The sheet says nothing. Instability: 6.4 to 7.6 deg/h of a consumer part on a table (libsurvive wiki, "IMU
        # variance measurements"); walk: there 0.0003 to 0.0005, on a walk 0.0011 deg/s/sqrt(s) (see `xsens-mtw`)
        drift=Drift.of_instability(10 * _DEG_H, time_s=100.0, walk=0.001 * _DEG),
        scale_sd=0.003,  # sheet: +-4 % over 125 K, so 0.03 %/K; assumed: 10 K since the turns
        cross_axis_sd=0.003,  # assumed: a box is turned on an edge to 0.2 degrees
        g_sensitivity_sd=0.02 * _DEG / GRAVITY_M_S2,  # assumed: six positions leave a fifth of the raw unit's
        limit=32767 / 16.4 * _DEG,  # sheet: FS_SEL 3; assumed: a foot needs the largest range
        resolution=1 / 16.4 * _DEG,  # sheet: 16.4 LSB/(deg/s)
    )
    acc = TriadPrior(
        # sheet: 300 ug/sqrt(Hz); its 8 mg rms over 94 Hz contradict that; memory: owners measure the former
        noise_density=0.3 * _MG * _ONE_SIDED,
        bias_sd=5 * _MG,  # sheet: 1.5 mg/K; assumed: 3 K since the six positions
        drift=Drift.of_instability(0.001, time_s=100.0, walk=0.0003),  # table: 0.001 m/s^2, 0.00016 (libsurvive wiki)
        scale_sd=0.002,  # sheet: 0.026 %/K; assumed: what six positions by hand leave
        cross_axis_sd=0.003,  # assumed: a box stands on its faces to 0.2 degrees
        limit=32767 / 2048 * GRAVITY_M_S2,  # sheet: AFS_SEL 3; assumed: heel strikes need the largest range
        resolution=1 / 2048 * GRAVITY_M_S2,  # sheet: 2048 LSB/g
    )
    return SensorPrior("mpu-9250", 400.0, gyr, acc, _ak8963(), _SHOE, _CRYSTAL)


def _ak8963() -> MagnetometerPrior:
    return MagnetometerPrior(
        rate_hz=100.0,  # sheet: continuous mode 2
        noise_sd_uT=0.5,  # assumed: the sheet is silent; raw readings at rest scatter by 2 to 7 steps
        offset_sd_uT=10.0,  # assumed: what Table 1's offsets leave room for besides the shoe; the sheet allows more
        scale_sd=0.02,  # memory: the sensitivity is adjusted per axis to within +-5 %
        cross_axis_sd=0.01,  # assumed: as the gyroscopes'
        lag_s=0.0036,  # memory: a measurement takes 7.2 ms; its middle is half of that ago
        limit_uT=4912.0,  # sheet
        resolution_uT=0.15,  # sheet: 16-bit output
    )


_SHOE = IronPrior(hard_sd_uT=9.5, soft_sd=0.06)
"""Ma Table 1: offsets of 143, 80 and -56 mG are 10 uT rms with what the chips add; an axis ratio of 0.896 in the
horizontal plane is near the median of this spread (1 - 1.67 * 0.06)."""


_REAL_SHOES = IronPrior(hard_sd_uT=3.5, soft_sd=0.06, hard_spread=1.3)
"""Measured by the walks themselves (`calibration.walk.find_iron`), |h| in uT: openshoe 1 to 2, gdin 4 to 5, mtig710 16,
sensors of mems_foot 2, 3, 6, 15, 22, 32, 42 and 92. Drawn: median 5, one in thirty above 60. Soft iron as `_SHOE`."""


def _mpu_9250_shoe() -> SensorPrior:
    calibrated = _mpu_9250()
    assert calibrated.mag is not None
    mag = replace(calibrated.mag, offset_sd_uT=0.0)  # in what was measured
    return replace(calibrated, name="mpu-9250-shoe", mag=mag, iron=_REAL_SHOES)


def _mpu_9250_raw() -> SensorPrior:
    calibrated = _mpu_9250()
    return replace(
        calibrated,
        name="mpu-9250-raw",
        gyr=replace(
            calibrated.gyr,
            bias_sd=2.5 * _DEG,  # sheet: +-5 deg/s
            scale_sd=0.015,  # sheet: +-3 % at 25 degrees C
            cross_axis_sd=0.01,  # sheet: +-2 %
            # sheet of the MPU-6050, the same family (PS-MPU-6000A-00 rev. 3.4): 0.1 deg/s/g; this one's is silent
            g_sensitivity_sd=0.1 * _DEG / GRAVITY_M_S2,
        ),
        acc=replace(
            calibrated.acc,
            bias_sd=35 * _MG,  # sheet: +-60 mg in x and y, +-80 mg in z
            scale_sd=0.015,  # sheet: +-3 %
            cross_axis_sd=0.01,  # sheet: +-2 %
        ),
    )


def _mpu_9250x8() -> SensorPrior:
    """Ma et al. 2018, section 5: eight MPU-9250 at 400 Hz, four on either side; assumed: plainly averaged.

    Which side a unit is on does not matter: the errors of each are its own, and as likely of either sign.
    """
    return replace(_mpu_9250(), name="mpu-9250x8", units=8)


def _xsens_mtw() -> SensorPrior:
    """Munoz Diaz et al. 2017, Tables 2 and 3; memory: Xsens' MTw leaflet. All of it factory-calibrated."""
    gyr = TriadPrior(
        noise_density=0.1 * _DEG / math.sqrt(100.0),  # Table 2: 0.1 deg/s a sample, assumed at 100 Hz
        bias_sd=0.1 * _DEG,  # Table 3: (-0.12, 0.06, -0.12) deg/s at the start of a walk
        # instability: memory, 20 deg/h; walk: Table 3, changes of (0.01, 0.01, 0.10) deg/s in 44 min
        drift=Drift.of_instability(20 * _DEG_H, time_s=100.0, walk=0.0011 * _DEG),
        scale_sd=0.002,  # assumed: factory-calibrated MEMS
        cross_axis_sd=0.0017,  # memory: alignment to 0.1 degrees
        g_sensitivity_sd=0.003 * _DEG / GRAVITY_M_S2,  # sheet of the MTi-300: 0.003 deg/s/g after calibration
        limit=1200 * _DEG,  # memory
    )
    acc = TriadPrior(
        noise_density=0.003 * _ONE_SIDED,  # memory: 0.003 m/s^2/sqrt(Hz)
        bias_sd=0.02,  # assumed: 2 mg
        drift=Drift.of_instability(0.0003, time_s=100.0, walk=0.0001),  # assumed: as on a table (libsurvive wiki)
        scale_sd=0.001,  # assumed
        cross_axis_sd=0.0017,  # memory: alignment to 0.1 degrees
        limit=160.0,  # memory
    )
    mag = MagnetometerPrior(
        rate_hz=100.0,
        noise_sd_uT=0.015 * math.sqrt(50.0),  # memory: 0.15 mG/sqrt(Hz); Table 2 takes it for the noise of a sample
        scale_sd=0.005,  # assumed: factory-calibrated
        cross_axis_sd=0.0017,  # memory: alignment to 0.1 degrees
        limit_uT=150.0,  # memory
    )
    iron = IronPrior(hard_sd_uT=5.0, soft_sd=0.03)  # assumed: section 3.2 says that it must be calibrated in place
    # assumed: a radio loses a sample in a thousand
    clock = ClockPrior(scale_sd=10e-6, dropped_share=0.001, burst=2.0)
    return SensorPrior("xsens-mtw", 100.0, gyr, acc, mag, iron, clock)


def _lord_gx5() -> SensorPrior:
    """Measured: our gdin and PyShoe recordings; memory: LORD's 3DM-GX5-25 data sheet."""
    gyr = TriadPrior(
        noise_density=0.005 * _DEG * _ONE_SIDED,  # memory; measured: 0.055 deg/s a sample at 200 Hz in gdin 35
        # memory: +-0.04 deg/s; measured at rest: 0.2 deg/s rms in four gdin walks, 0.05 in 15 of PyShoe's
        bias_sd=0.1 * _DEG,
        drift=Drift.of_instability(8 * _DEG_H, time_s=100.0, walk=0.0003 * _DEG),  # memory: 8 deg/h; walk assumed
        scale_sd=0.0005,  # memory: +-0.05 % stability; assumed: as much again from the factory
        cross_axis_sd=0.0009,  # memory: alignment to 0.05 degrees
        g_sensitivity_sd=0.01 * _DEG / GRAVITY_M_S2,  # assumed: between a raw MEMS part and a compensated MTi
        limit=500 * _DEG,  # measured: gdin 15, 35 and 43 end at 8.73 rad/s
    )
    acc = TriadPrior(
        noise_density=0.1 * _MG * _ONE_SIDED,  # measured: 0.010 m/s^2 a sample at 200 Hz in gdin 35
        bias_sd=2 * _MG,  # memory: +-2 mg
        drift=Drift.of_instability(0.04 * _MG, time_s=100.0, walk=0.0001),  # memory: 0.04 mg; walk assumed
        scale_sd=0.0005,  # memory: +-0.05 % stability
        cross_axis_sd=0.0009,  # memory: alignment to 0.05 degrees
        limit=20 * GRAVITY_M_S2,  # measured: gdin 35 reaches 136 m/s^2, so not the +-8 g version
    )
    mag = MagnetometerPrior(
        rate_hz=200.0,  # measured: a new value in every row of the gdin walks; assumed: no more than that
        noise_sd_uT=0.05,  # measured: 0.04 to 0.09 uT within half a second of standing in gdin 35
        lag_s=0.022,  # measured: 20 to 25 ms on ten gdin walks, where the field in nav is smoothest over the samples
        scale_sd=0.005,  # assumed: factory-calibrated
        cross_axis_sd=0.0009,  # memory: alignment to 0.05 degrees
        limit_uT=800.0,  # memory: +-8 G
    )
    # measured: |h| 4 to 5 uT on gdin, 1 to 2 on openshoe; soft iron assumed: a metal-free case on a strap
    iron = IronPrior(hard_sd_uT=3.0, soft_sd=0.02)
    return SensorPrior("lord-gx5", 200.0, gyr, acc, mag, iron, _CRYSTAL)  # measured: stamps even to 3 us, none lost


def _lord_gx5_900() -> SensorPrior:
    """Memory: the data sheet offers ranges up to 900 deg/s. The simulated foot peaks at 540 and, running, at 900."""
    slow = _lord_gx5()
    return replace(slow, name="lord-gx5-900", gyr=replace(slow.gyr, limit=900 * _DEG))


def _kvh_1750() -> SensorPrior:
    """Memory: KVH's 1750 IMU data sheet; Munoz Diaz et al. 2017, section 2.2, on its Allan deviation."""
    gyr = TriadPrior(
        noise_density=0.012 * _DEG / 60,  # memory: angle random walk 0.012 deg/sqrt(h)
        bias_sd=1 * _DEG_H,  # memory: offset +-2 deg/h
        drift=Drift.of_instability(0.05 * _DEG_H, time_s=1000.0),  # memory; section 2.2: ten times a MEMS part's time
        scale_sd=1e-4,  # memory: 50 ppm nonlinearity, 200 ppm over temperature
        cross_axis_sd=0.0004,  # memory: axes to 0.4 mrad
        limit=490 * _DEG,  # sheet as quoted by public drivers: +-490 deg/s
    )
    return SensorPrior("kvh-1750", 100.0, gyr, _KVH_ACC, None, IronPrior(), _CRYSTAL)


_KVH_ACC = TriadPrior(
    noise_density=0.12 * _MG,  # memory: velocity random walk 0.12 mg/sqrt(Hz), which is 0.23 ft/s/sqrt(h)
    bias_sd=1 * _MG,  # memory: offset +-2 mg
    drift=Drift.of_instability(0.05 * _MG, time_s=100.0),  # memory: instability below 0.05 mg
    scale_sd=0.001,  # assumed
    cross_axis_sd=0.001,  # memory: axes to 1 mrad
    limit=10 * GRAVITY_M_S2,  # memory: the +-10 g version
)


def _munoz_diaz_table_2() -> SensorPrior:
    """Munoz Diaz et al. 2017, Table 2: added to rates of a 1750 that count as true, and to a computed field."""
    gyr = TriadPrior(
        noise_density=0.1 * _DEG / math.sqrt(100.0),  # Table 2: 0.1 deg/s a sample; assumed at 100 Hz
        bias=(-0.1 * _DEG, 0.1 * _DEG, -0.1 * _DEG),  # Table 2
        limit=490 * _DEG,  # that of the 1750
    )
    mag = MagnetometerPrior(rate_hz=100.0, noise_sd_uT=0.015)  # Table 2; assumed: a sample in every row at 100 Hz
    return SensorPrior("munoz-diaz-table-2", 100.0, gyr, _KVH_ACC, mag)


def _munoz_diaz_table_3() -> SensorPrior:
    """Munoz Diaz et al. 2017, Table 3: an MTw whose biases were measured before and after 44 minutes."""
    mtw = _xsens_mtw()
    start, end = (-0.12, 0.06, -0.12), (-0.13, 0.05, -0.22)  # Table 3, deg/s
    x, y, z = ((b - a) * _DEG / (44 * 60) for a, b in zip(start, end, strict=True))
    # assumed: steadily from the one to the other, for a walk of that length; about it the MTw's AR(1)
    drift = replace(mtw.gyr.drift, walk=0.0, trend=(x, y, z))
    bias = (start[0] * _DEG, start[1] * _DEG, start[2] * _DEG)
    gyr = replace(mtw.gyr, bias=bias, bias_sd=0.0, drift=drift)
    assert mtw.mag is not None
    # Table 2 has 0.015 uT, taken for an MTw's; memory: that over sqrt(Hz), so 0.11 up to 50 Hz. Assumed: over 10 Hz,
    # with which an uncalibrated magnetometer does what it does in Figure 13b (seeds 1 and 2)
    mag = replace(mtw.mag, noise_sd_uT=0.05)
    return replace(mtw, name="munoz-diaz-table-3", gyr=gyr, mag=mag)


PRESETS: dict[str, Callable[[], SensorPrior]] = {
    "ideal": _ideal,
    "demo": _demo,
    "mpu-9250": _mpu_9250,
    "mpu-9250-raw": _mpu_9250_raw,
    "mpu-9250-shoe": _mpu_9250_shoe,
    "mpu-9250x8": _mpu_9250x8,
    "xsens-mtw": _xsens_mtw,
    "lord-gx5": _lord_gx5,
    "lord-gx5-900": _lord_gx5_900,
    "kvh-1750": _kvh_1750,
    "munoz-diaz-table-2": _munoz_diaz_table_2,
    "munoz-diaz-table-3": _munoz_diaz_table_3,
}
"""What `preset` knows."""
