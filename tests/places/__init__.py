"""Places that are recognized: simulated fields over a floor, and walks over it."""
