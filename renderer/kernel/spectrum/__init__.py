"""Spectral rendering: the wavelengths of a path, colours at wavelengths, and the film's response.

wavelengths  samples a path's wavelengths; linear Rec.709 of light at wavelengths
upsampling   reflectances, light and coefficients at wavelengths from linear Rec.709, by a table of sigmoids
indices      indices of refraction at wavelengths: dispersive glass, and conductors from a table
"""
