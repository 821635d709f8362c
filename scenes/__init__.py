"""Makes real frames for the bench from scenes that are code: procedural geometry and textures, no downloads."""
