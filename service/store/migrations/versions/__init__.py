"""One file a step, each with the step before it as `down_revision`."""
