"""Looking on at running hunts."""
