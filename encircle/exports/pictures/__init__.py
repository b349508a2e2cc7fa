"""The picture of a hunt at a moment: what a video consists of."""
