"""Specular manifold sampling: light that reaches a vertex through one to six smooth interfaces.

Zeltner, Georgiev & Jakob, "Specular Manifold Sampling for Rendering High-Frequency Caustics and Glints" (2020), in its unbiased
form; Hanika, Droske & Fascione, "Manifold Next Event Estimation" (2015).

caster.py          the local geometry of a smooth interface at a hit
differentials.py   rays with derivatives, through interfaces and over distances; the half-vector constraint
lamps.py           choice of a point on a small lamp
photons.py         photons that lamps send through casters
brightness.py      where these find caustics; choice of a caster, and the probability of a walk
seeds.py           choice of the first direction of a walk
walk.py            Newton's method for the direction that reaches the lamp
chain.py           the split of light between manifold sampling and BSDF sampling
meeting.py         light that a bright spot sends on: weights of walks against photons
estimate.py        the estimator: a solution's light divided by the probability of finding it
"""
