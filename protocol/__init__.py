"""All messages between service, workers, sites, page and add-on. Imports no numba, since the service imports it.

contract.py      tasks, queues, keys and results; start here
events.py        the events that workers send about their work
joint.py         batches of a tile that the slots of one worker render together
card.py          batches for workers with graphics cards
view_parts.py    parts of live views
explained.py     explanations of pixels
site.py          messages from the machines of a site to its reducer, which adds up their results
terms.py         a worker's run-time settings, and its capabilities; hours.py: its working hours
vitals.py        a machine's memory use, and the end of its log
lifeline.py      distinguishes a dead worker from a slow one
broker.py        Celery's settings for both ends of the queue
redis_tls.py     addresses of a Redis that is reached over TLS
sums.py          serialization of a batch's sums
deep_sums.py     of deep pixels, behind these
result_bytes.py  serialization of a result; json_head.py: of a JSON object followed by bytes
blends.py        scenes that Blender has to convert
pictures.py      packets with pictures for viewers; coarse.py: their lossy encoding; mesh.py: preview meshes
layout.py        declaration of binary layouts; generate.py: code for the page and the add-on, generated from them
event_stream.py  events of GET /api/events; websocket.py, live.py and viewport.py: messages of WebSockets
reproduce.py     the command that renders a failed batch again, without a farm
"""
