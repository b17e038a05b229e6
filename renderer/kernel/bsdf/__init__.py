"""Scattering, one model a file, each with eval_x beside pdf_x and sample_x.

All work in a local frame whose z is the shading normal on the viewer's side: wo points to the viewer (z > 0), wi to the
light; both are unit. eval_x gives f(wo, wi) |cos wi| per channel; sample_x gives (wi, eval / pdf, pdf), with a weight of 0
where nothing is scattered. Discrete (specular) models have only sample_x: no other direction can find their peak.
"""
