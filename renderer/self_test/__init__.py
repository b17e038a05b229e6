"""The self-test of graphics cards: films of built-in scenes, compared with the CPU's.

Programs call `run_self_test` of renderer/cuda/verdicts.py, which runs it in a process of its own and keeps the results.

scenes.py    the scenes
compare.py   renders and compares them
__main__.py  the command
"""
