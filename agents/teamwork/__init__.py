"""What a robot knows of its peers, and when it publishes to them."""
