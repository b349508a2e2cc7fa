"""The robot as a process: asyncio, signals, and the connection."""
