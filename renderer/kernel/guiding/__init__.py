"""Training of path guides: pilot paths record the light that arrives at their vertices.

`pilot.py` follows them, renderer/scene/guide.py makes the guide (renderer/arrays/guide.py), and steps/guide.py samples it.
"""
