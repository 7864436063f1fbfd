"""Raw samples: the clock behind their stamps, units, gaps, clipped peaks, and what a sample hides of its period."""
