"""Use cases of jobs: creating, changing, listing and describing them, without HTTP."""
