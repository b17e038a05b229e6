"""Use cases of scenes: uploading, opening examples, listing, describing and deleting them, without HTTP."""
