"""The world as a process: asyncio, signals, deadlines, and the connection."""
