"""The person of a scene: found, lifted out of views, labelled, kept beside it."""
