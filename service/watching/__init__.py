"""What is shown: pictures of a film at any moment, and who is told that it grew."""
