"""The Rayfarm render engine for Blender: F12 and the rendered viewport show pictures rendered by a farm.

Modules that need Blender are imported in `register`; all others can be imported and tested without it.
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
    """Registers the add-on; called by Blender."""
    from .ui import registration

    registration.register()


def unregister() -> None:
    """Unregisters the add-on; called by Blender."""
    from .ui import registration

    registration.unregister()
