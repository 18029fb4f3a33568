"""The account of a run as tables."""

from pathlib import Path

from benchmarks.fuzz.running import Account


def table(account: Account) -> str:
    """Return by reader how many cases ended how."""
    lines = [f"{'reader':<12}{'cases':>9}{'read':>9}{'refused':>9}{'findings':>10}{'wrote to stderr':>17}"]
    totals = [0] * 5
    for reader, ends in account.ends.items():
        numbers = [sum(ends.values()), ends["read"], ends["refused"], ends["finding"], account.said[reader]]
        totals = [a + b for a, b in zip(totals, numbers, strict=True)]
        lines.append(_line(reader, numbers))
    return "\n".join([*lines, _line("all", totals)])


def groups(account: Account) -> str:
    """Return what was found as Markdown: by reader, kind and place, with an example of each."""
    lines = ["| reader | what | innermost frame of endoct | n | example | says |", "|---|---|---|---|---|---|"]
    for (reader, kind, where), count in sorted(account.found.items(), key=lambda item: (item[0][0], -item[1])):
        stored, case, told = account.examples[reader, kind, where][0]
        place = f"{stored}" if stored is not None else f"number {case.number}"
        said = next((line for line in reversed(told.splitlines()) if line.strip()), "")[:160].replace("|", "/")
        lines.append(f"| {reader} | {kind} | {where} | {count} | {place} | {said} |")
    return "\n".join(lines)


def write_account(account: Account, folder: Path, title: str) -> None:
    """Write the tables into ``folder`` as ``findings.md``."""
    folder.mkdir(parents=True, exist_ok=True)
    said = "\n".join(f"- {key!r}" for key in sorted(account.said_examples)[:40])
    text = f"# {title}\n\n```\n{table(account)}\n```\n\n{groups(account)}\n\n## Written to stderr\n\n{said}\n"
    (folder / "findings.md").write_text(text, encoding="utf-8", errors="backslashreplace")


def _line(name: str, numbers: list[int]) -> str:
    n, read, refused, found, said = numbers
    return f"{name:<12}{n:>9}{read:>9}{refused:>9}{found:>10}{said:>17}"
