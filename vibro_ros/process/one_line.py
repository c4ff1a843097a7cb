"""Text from elsewhere, fit for one line of a terminal or a log."""

LONGEST = 2000
"""Characters of a text that are shown, unless the caller wants fewer."""


def one_line(text: object, longest: int = LONGEST) -> str:
    """`text` without line breaks: what cannot be printed is escaped, and beyond `longest` its middle is left out.

    A file's name may hold any byte but two. Printed as it is, one would end the program (bytes that are no UTF-8),
    feign another message (a line break), or change the terminal's colours (escape sequences).
    """
    shown = str(text)
    if len(shown) > longest:
        shown = f"{shown[:longest // 2]}…{shown[-(longest // 2):]}"
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in shown)
