"""The page that shows a hunt: its scripts, the file that holds a whole replay, the server."""
