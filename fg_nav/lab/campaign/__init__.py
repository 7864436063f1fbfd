"""Many walks by many methods: what is made once is kept, and a run makes only what is missing.

walks      of scenarios and seeds, or recorded                                            (`sources`)
results    one small file each, with what it was made with                        (`kept`, `settings`)
making     a walk is simulated once for all methods that are tried on it                       (`made`)
"""
