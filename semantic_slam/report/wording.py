"""Numbers and lists as a reader expects them."""

from typing import TypeGuard


def known(value: float | None) -> TypeGuard[float]:
    """Whether there is a number."""
    return value is not None and value == value


def number(value: float | None, digits: int = 2) -> str:
    """Fixed digits, a dash for what is not known, a real minus sign."""
    if not known(value):
        return "–"
    text = f"{value:.{digits}f}"
    return text.replace("-", "−") if float(text) else text.lstrip("-")


def percent(value: float) -> str:
    """Per cent that never round to 0 or 100 what is neither."""
    if not known(value):
        return "–"
    if value <= 0.0:
        return "0 %"
    if 0.9995 <= value < 1.0 - 1e-9:
        return "> 99.9 %"
    if value < 0.0005:
        return "< 0.1 %"
    return f"{100 * value:.1f} %" if 0.995 <= value < 1.0 - 1e-9 or value < 0.01 else f"{100 * value:.0f} %"


def listed(items: list[str], word: str = "and") -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {word} {items[-1]}"
