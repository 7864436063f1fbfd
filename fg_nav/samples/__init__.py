"""Raw samples: units, the clock behind stamps, outliers, clipped peaks, gaps, coning; the intake of a stream."""
