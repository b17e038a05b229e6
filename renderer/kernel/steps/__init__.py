"""The steps of a path: each rule of light transport, once, for every backend.

A step takes and returns plain values and named tuples of them (state.py). A value is a number of one path, of eight lanes
(renderer/wide), or of a thread. Steps contain no lists, rows of memory, or instructions of a certain processor: backends
(renderer/kernel/backends) store the paths and decide the order of their steps:

spawn_camera_ray     the ray of a sample
medium_event         where a path scatters in its medium
pass_through         whether a ray passes the surface that it hits, and absorption on the way
emitted_light        emission that a ray hits, with its MIS weight
record_first_hit     the values of a first hit that the film stores
sample_direct_light  a light's contribution through a vertex, and the shadow ray towards it
aim                  directions towards targets, mixed with those of the BSDF
scatter              the next ray
continue_or_end      limits, and Russian roulette
"""
