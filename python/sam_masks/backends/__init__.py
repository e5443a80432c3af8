"""What makes masks of an image. Every backend is a class with segment(image): RGB uint8 to a list of masks."""


class BackendError(Exception):
    """A backend cannot be had; the message says what to do."""
