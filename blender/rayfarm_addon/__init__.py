"""Rayfarm as a render engine of Blender: F12 and the rendered viewport are pictures of a farm.

Modules that need Blender are imported when it registers the add-on; all others run, and are tested, without it.
"""

bl_info = {
    "name": "Rayfarm",
    "author": "The Rayfarm developers",
    "version": (0, 0, 0),
    "blender": (4, 2, 0),
    "location": "Properties > Render > Render Engine",
    "description": "Renders on a Rayfarm render farm, viewport included",
    "category": "Render",
}


def register() -> None:
    """Called by Blender."""
    from .ui import registration

    registration.register()


def unregister() -> None:
    """Called by Blender."""
    from .ui import registration

    registration.unregister()
