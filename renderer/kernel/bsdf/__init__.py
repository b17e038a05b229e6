"""BSDF models, one per file, each with eval_x and pdf_x (or both as eval_and_pdf_x) and sample_x.

All use a local frame whose z is the shading normal on the viewer's side: wo points to the viewer (z > 0), wi to the light, below
(z < 0) if the model transmits; both are unit. eval_x returns f(wo, wi) |cos wi| per channel; sample_x returns (wi, eval / pdf,
pdf), with a weight of 0 where nothing is scattered. Discrete (specular) models have only sample_x, since other sampling cannot
find their directions.

models        diffuse, mirror, glass, metallic_roughness (the fast ones), conductor, blinn_phong, layered (all of glTF), hair
lobes         clearcoat, sheen, rough_glass, iridescence (reflectance of a thin film): the components of layered.py
foundations   microfacet (GGX), fresnel, energy and glass_energy (multiple scattering), layer_balance (what layers transmit
              to those below), albedo_tables (generates the .npy files)
"""
