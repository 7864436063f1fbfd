"""Results on disk, one small file each, for campaigns and for the papers' experiments.

files      a file is there complete or not at all (`atomic_write`); marker files say which command fills a folder
code       sum over the sources and the libraries that made a result
results    content with the settings that made it; what one method made of one walk, by its key
"""
