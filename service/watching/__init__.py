"""What viewers see: pictures of a film at any moment, and the news that it has grown."""
