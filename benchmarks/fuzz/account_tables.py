"""The account of a campaign as tables."""

from pathlib import Path

from benchmarks.fuzz.campaign import Account


def table(account: Account) -> str:
    """Return by reader how many cases ended how."""
    lines = [f"{'reader':<12}{'cases':>9}{'entered':>9}{'read':>9}{'refused':>9}{'findings':>10}{'to stderr':>11}"]
    totals = [0] * 6
    for reader, ends in account.ends.items():
        n = ends["read"] + ends["refused"] + ends["finding"]
        numbers = [n, ends["entered"], ends["read"], ends["refused"], ends["finding"], account.printed[reader]]
        totals = [a + b for a, b in zip(totals, numbers, strict=True)]
        lines.append(_line(reader, numbers))
    return "\n".join([*lines, _line("all", totals)])


def kinds(account: Account) -> str:
    """Return by sound file how many of those made of it were tried, were entered beyond the first check, and read."""
    lines = [f"{'reader: sound file':<52}{'cases':>9}{'entered':>9}{'read':>9}"]
    for (reader, sound), ends in sorted(account.of_sound.items()):
        lines.append(f"{f'{reader}: {sound}':<52}{ends['cases']:>9}{ends['entered']:>9}{ends['read']:>9}")
    return "\n".join(lines)


def groups(account: Account) -> str:
    """Return the findings as Markdown: by reader, kind and place, with an example of each."""
    lines = ["| reader | what | innermost frame of endoct | n | example | says |", "|---|---|---|---|---|---|"]
    for (reader, kind, where), count in sorted(account.findings.items(), key=lambda item: (item[0][0], -item[1])):
        stored, case, message = account.examples[reader, kind, where][0]
        place = f"{stored}" if stored is not None else f"number {case.number}"
        last = next((line for line in reversed(message.splitlines()) if line.strip()), "")[:160].replace("|", "/")
        lines.append(f"| {reader} | {kind} | {where} | {count} | {place} | {last} |")
    return "\n".join(lines)


def write_account(account: Account, folder: Path, title: str) -> None:
    """Write the tables into ``folder`` as ``findings.md``."""
    folder.mkdir(parents=True, exist_ok=True)
    printed = "\n".join(f"- {key!r}" for key in sorted(account.printed_examples)[:40])
    text = (
        f"# {title}\n\n```\n{table(account)}\n```\n\n{groups(account)}\n\n## Entered\n\n```\n{kinds(account)}\n```\n\n"
        f"## Written to stderr\n\n{printed}\n"
    )
    (folder / "findings.md").write_text(text, encoding="utf-8", errors="backslashreplace")


def _line(name: str, numbers: list[int]) -> str:
    n, entered, read, refused, findings, printed = numbers
    return f"{name:<12}{n:>9}{entered:>9}{read:>9}{refused:>9}{findings:>10}{printed:>11}"
