"""Views that somebody looks at now: pictures without jobs, which leave nothing behind."""
