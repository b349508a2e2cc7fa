"""What hunts and scenarios look like in a notebook. Nothing is needed that is not in the base."""
