"""Text in a document that a program writes, between two marks."""


def replaced(document: str, begin: str, end: str, text: str) -> str:
    """`document` with what stands between the lines `begin` and `end` replaced by `text`.

    Raises
    ------
    ValueError
        If the marks are not there, once each and in order.
    """
    head, found_begin, rest = document.partition(begin)
    _, found_end, tail = rest.partition(end)
    if not (found_begin and found_end) or begin in rest or end in tail:
        raise ValueError(f"the table's place is not marked; write '{begin}' and '{end}' once each")
    return f"{head}{begin}\n{text}\n{end}{tail}"
