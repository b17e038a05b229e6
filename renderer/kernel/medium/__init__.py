"""What light passes through: where a path is, how far it goes, how it is scattered there; and the insides of skin and marble."""
