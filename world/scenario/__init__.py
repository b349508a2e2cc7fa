"""The scenario: its model, and plain sentences for what pydantic refuses."""
