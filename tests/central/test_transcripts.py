"""Each file in transcripts/ defines one rule. ``pytest --rewrite`` rewrites all files. Commit only
changes that you can explain.
"""

from pathlib import Path

import pytest
from central.transcript import Transcript

FOLDER = Path(__file__).parent / "transcripts"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.txt")), ids=lambda path: path.stem)
def test_transcript_matches_its_approved_output(path: Path, rewrite: bool) -> None:
    text = path.read_text()
    title, *blocks = text.strip().split("\n\n")
    transcript, played = Transcript(), [title]
    for block in blocks:
        commands = block.split("\n----")[0]
        output = [transcript.play(command) for command in commands.splitlines()]
        played.append(f"{commands}\n----\n" + "\n".join(filter(None, output)))
    result = "\n\n".join(part.rstrip() for part in played) + "\n"
    if rewrite:
        path.write_text(result)
    assert result == text
