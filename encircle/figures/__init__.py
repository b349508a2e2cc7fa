"""Pictures of one hunt."""
