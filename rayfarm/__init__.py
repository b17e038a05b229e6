"""The command line, the one-command local farm, and the Python client.

cli.py          the program `rayfarm`: one file a command under commands/
options.py      the options that commands share
scene_files.py  which files belong to a scene that a person names
output_files.py pictures on their way to a disk
client.py       the Python client of a farm's service
movie.py        frames as a film
shot.py         frames that a farm renders
answers.py      what it answers, as dataclasses
local/          a whole farm on this machine: Redis, service and worker as supervised processes
"""

from rayfarm.answers import BadSample, Camera, Frame, Job, Scene, Shot, Worker
from rayfarm.client import Client, ClientError

__all__ = ["BadSample", "Camera", "Client", "ClientError", "Frame", "Job", "Scene", "Shot", "Worker"]
