"""Views that somebody is looking at: pictures without jobs, which leave nothing behind."""
