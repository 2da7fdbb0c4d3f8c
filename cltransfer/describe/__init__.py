"""A clip, a run or a camera path in a cinematographer's words."""
