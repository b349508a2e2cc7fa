"""What a team that knows everything reaches, as a yardstick for policies."""
