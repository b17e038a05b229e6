"""Live views: interactive pictures of scenes, rendered without jobs and not stored."""
