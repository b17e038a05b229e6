import math
import numpy as np
from renderer.arrays.rows import *
from renderer.arrays import rows
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.fetch import row, columns
from renderer.kernel.light.lights import LightSample
from renderer.kernel.surface.surface import triangle_point
from renderer.kernel.sampling.warp import square_to_triangle
from renderer.wide.values import *

_Z = np.float32(0)
_O = np.float32(1)


@device
def environment_seen(scene, d, judged):
    z = nil(d[0])
    return (z, z, z), z


@device
def emission(scene, m, uv, uv1, front):
    e = columns(scene.material, m, COLUMNS, rows.EMISSION, 3)
    z = nil(e[0])
    return where3(front, e, (z, z, z))


@device
def primitive_light_pdf(scene, light, p, n, hit, cosine):
    chance = lookup(scene.light_cdf, light + np.uint32(1)) - lookup(scene.light_cdf, light)
    d = vec.sub(hit, p)
    return chance * vec.dot(d, d) / max(cosine * lookup(scene.light_area, light), np.float32(1e-30))


@device
def sample_light(scene, p, n, choice, u):
    light = u32(to_int(nil(choice)))
    i = nil(light)
    for k in range(len(scene.light_primitive) - 1):
        i = where(choice >= scene.light_cdf[k + 1], light + np.uint32(k + 1), i)
    lo = lookup(scene.light_cdf, i)
    chance = lookup(scene.light_cdf, i + np.uint32(1)) - lo
    prim = lookup(scene.light_primitive, i)
    b, c = square_to_triangle(u)
    q, error, normal = triangle_point(scene.position, scene.triangle, prim, b, c)
    d = vec.sub(q, p)
    sq = vec.dot(d, d)
    w = vec.scale(d, _O / math.sqrt(sq))
    proj = -vec.dot(normal, w)
    ok = (sq > _Z) & (abs(proj) > _Z)
    part = row(scene.triangle, prim, 4)[3]
    material = row(scene.part, part, PART_COLUMNS)[PART_MATERIAL]
    r = emission(scene, material, 0, 0, proj > _Z)
    nn = vec.scale(normal, np.float32(0.5) / lookup(scene.light_area, i))
    dist = where(vec.dot(nn, vec.neg(w)) > _Z, error, -error)
    end = vec.add(q, vec.scale(nn, dist))
    pdf = where(ok, np.float32(2) * sq / abs(proj) * chance, _Z)
    return LightSample(w, end, r, pdf, sq < _Z)
