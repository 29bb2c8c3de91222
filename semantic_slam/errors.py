"""The one error family. Every message names the fault and its remedy in a single line."""


class SemanticSlamError(Exception):
    """Anything this package raises on purpose."""


class InputError(SemanticSlamError):
    """Bad input or usage; a command line ends with exit code 2 and this text."""
