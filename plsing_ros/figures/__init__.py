"""Pictures of scenes and servo runs."""
