"""Campaigns: many methods on many walks on a Dask cluster; results are stored, and a run makes only what is missing."""
