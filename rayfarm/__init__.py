"""The command line, the one-command local farm, and the Python client.

cli.py          the program `rayfarm`: one file a command under commands/
options.py      the options that commands share
scene_files.py  which files belong to a scene that a person names
client.py       the Python client of a farm's service
local/          a whole farm on this machine: Redis, service and worker as supervised processes
"""

from rayfarm.client import Client

__all__ = ["Client"]
