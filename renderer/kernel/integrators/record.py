"""The protocol of one path, for a person who looks into a pixel: a row of numbers for each thing that its ray met.

The integrators write it where they are given rows to write to. Pictures are rendered with none, by the same machine code:
what is recorded is what the film got, to the bit.
"""

from __future__ import annotations

from renderer.jit import out_of_line, subroutine

__all__ = ["COLUMNS", "MISSED", "PASSED", "SURFACE", "UNSEEN", "record_light", "record_vertex"]

# Kinds of rows. UNSEEN: none written.
UNSEEN, SURFACE, PASSED, MISSED = range(4)

# Columns, float64.
KIND, OBJECT, MATERIAL, DISTANCE, PDF = range(5)
POINT, NORMAL, DIRECTION, THROUGHPUT, BEFORE, EMITTED, DIRECT = range(5, 26, 3)
COLUMNS = 26


@subroutine
def record_vertex(log, row, kind, number, material, distance, pdf, point, normal, direction, throughput, before):
    """What a ray met. pdf: with which its direction was chosen; throughput: on arrival; before: the radiance so far."""
    out_of_line()
    log[row, KIND] = kind
    log[row, OBJECT] = number
    log[row, MATERIAL] = material
    log[row, DISTANCE] = distance
    log[row, PDF] = pdf
    for i, v in ((POINT, point), (NORMAL, normal), (DIRECTION, direction), (THROUGHPUT, throughput), (BEFORE, before)):
        log[row, i] = v[0]
        log[row, i + 1] = v[1]
        log[row, i + 2] = v[2]
    for i in range(3):  # what follows may not be written
        log[row, EMITTED + i] = before[i]
        log[row, DIRECT + i] = before[i]


@subroutine
def record_light(log, row, column, radiance):
    """The radiance so far: from column EMITTED on with the vertex's own light, from DIRECT on with the lights it sees."""
    out_of_line()
    for i in range(3):
        for j in range(column, COLUMNS, 3):
            log[row, j + i] = radiance[i]
