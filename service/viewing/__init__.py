"""Live views: pictures of scenes without jobs, which leave nothing behind."""
