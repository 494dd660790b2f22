"""bscd's own errors; each prints as one sentence: what is wrong, where, and what to do."""


class BscdError(Exception):
    """Anything bscd refuses or fails at; the command line prints it as one line and exits with 1."""


class InputError(BscdError):
    """What the user gave can not be used: a file, a manifest row, a value. Nothing was changed."""


class CheckFailedError(BscdError):
    """A measurement did not pass its check (dots missing, image saturated, prism in the way) and was stopped."""
