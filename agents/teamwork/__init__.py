"""What a robot knows of its peers, and when it tells them something."""
