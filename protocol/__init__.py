"""All messages between service, workers, sites, page and add-on. Imports no numba, since the service imports it.

contract.py      tasks, queues, keys and results; start here
joint.py         batches of a tile that the slots of one machine render together
view_parts.py    pieces of interactive views
explained.py     explanations of pixels
site.py          messages from the machines of a site to its reducer
terms.py         a worker's run-time settings, and its capabilities; hours.py: its working hours
vitals.py        a machine's memory and load, and the end of its log
lifeline.py      distinguishes a dead worker from a slow one
broker.py        Celery's settings for both ends of the queue
redis_tls.py     addresses of a Redis that is reached over TLS
sums.py          serialization of a batch's sums
result_bytes.py  serialization of a result
blends.py        scenes that Blender has to convert
event_stream.py  events of GET /api/events; websocket.py, live.py and viewport.py: messages of WebSockets
reproduce.py     the command that renders a failed batch again, without a farm
"""
