"""Live views: interactive pictures of scenes, rendered by workers without a job. One picture of each scene is stored.

A view from the page's request to its pictures:
    view_request.py    resolves a request to a compiled scene and render settings; which view is a scene's home view
    view_scheduler.py  the thread that sends pieces of all views to workers and takes in their answers; start here
    session.py         one view: its request, its pictures so far, its messages to the page
    passes.py          the pieces of a view, and their order
    canvas.py          the sums of one resolution of a view
    denoised.py        when a view's picture is denoised next, and the latest denoised one
Used by the scheduler:
    pending.py, pending_frames.py         messages that are not answered
    view_workers.py, view_cards.py        the workers, and their graphics cards, that render views
    sample_costs.py                       measured seconds per sample
    frame_cache.py                        frames of animations that views have shown
    memory_limit.py                       the limit of all views' memory
    picking.py, pixel_direction.py        the surface under a pixel
    waker.py                              interrupts the wait for answers
Posters, the stored pictures:
    posters.py         takes them from views
    idle_posters.py    renders missing ones while the farm is idle
    poster_choice.py   whether a picture replaces a poster
    poster_store.py    JPEGs, their blobs and rows
Also here:
    explaining.py      explains a pixel: its paths, traced again
    presence.py        the people who view the same scene
"""
