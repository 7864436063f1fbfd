"""Results on disk, one small file each, for campaigns and for the papers' experiments."""
