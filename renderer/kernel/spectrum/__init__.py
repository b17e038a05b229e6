"""Spectral rendering: the wavelengths of a path, colours at wavelengths, and the film's response.

wavelengths  samples a path's wavelengths; linear Rec.709 of light at wavelengths
upsampling   reflectances, light and coefficients at wavelengths from linear Rec.709, by a table of sigmoids
light_planes a path's light by group and by path as linear Rec.709
indices      indices of refraction at wavelengths: dispersive glass, and conductors from a table
"""
