"""Every message between service, workers, sites, page and add-on. Imports no numba, since the service imports it.

Between the service and those who watch:
    pictures.py       packets of live tiles, films and views; coarse.py: views that are still noisy
    live.py           messages of a job's WebSocket
    viewport.py       messages of a view's WebSocket
    websocket.py      how these are encoded and decoded
    layout.py         declares binary layouts
    generate.py       writes the page's decoders and the add-on's copies

Between the service, a site's reducer and workers; start with contract.py:
    contract.py       tasks, queues, keys and results
    events.py         the events of results
    joint.py          batches of a tile that the slots of one machine render together
    view_parts.py     parts of interactive views
    explained.py      explanations of pixels
    site.py           messages from the machines of a site to its reducer
    terms.py          a worker's run-time settings, and its capabilities; hours.py: its working hours
    vitals.py         a machine's memory and load, and the end of its log
    lifeline.py       tells a dead worker from a slow one
    broker.py         Celery's settings for both ends of the queue
    redis_tls.py      addresses of a Redis that is reached over TLS
    sums.py           serialization of a batch's sums
    result_bytes.py   serialization of a result; json_head.py: a JSON object and bytes
    blends.py         scenes that Blender has to convert
    reproduce.py      the command that renders a failed batch again, without a farm
"""
