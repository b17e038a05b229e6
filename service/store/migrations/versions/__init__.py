"""One file per migration, each with its predecessor as `down_revision`."""
