"""What others are told when a job ends: by webhook, or by a program of the farm's owner."""
