"""Text from elsewhere, fit for one line of a terminal or a log."""

LONGEST = 2000
"""Characters of a text that are shown; what lies between its two ends is left out."""


def one_line(text: object) -> str:
    """`text` without line breaks: what cannot be printed is escaped, and what is too long is cut in its middle.

    A file's name may hold any byte but two. Printed as it is, one would end the program (bytes that are no UTF-8),
    feign another message (a line break), or change the terminal's colours (escape sequences).
    """
    shown = str(text)
    if len(shown) > LONGEST:
        shown = f"{shown[:LONGEST // 2]}…{shown[-LONGEST // 2:]}"
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in shown)
