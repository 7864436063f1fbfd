"""Campaigns: many methods on many walks on a Dask cluster; results are stored, and a run makes only what is missing.

plan       what is to be made (`plan`): walks (`walks`) by methods (`methods`)
execution  a walk is one task, for all methods that are tried on it (`execute`, `dispatch`, `cluster`)
results    in the folder (`fg_nav.lab.store`), and in tables at the end (`folder`)
"""
