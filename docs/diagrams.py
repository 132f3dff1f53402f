"""The block diagrams of the course: ``python docs/diagrams.py docs/images`` writes them.

Coordinates are pixels, y downwards. Signals run along horizontal and vertical lines.
"""

import sys
from pathlib import Path

STYLE = (
    "text{fill:#1a1a1a;text-anchor:middle}.small{font-size:14px}"
    ".block{fill:#fff;stroke:#333;stroke-width:1.6}.law{fill:#eef4fb;stroke:#0072B2}"
    ".observer{fill:#fdf3e7;stroke:#D55E00}.rig{fill:#eef8f3;stroke:#009E73}"
    ".sum{fill:#fff;stroke:#333;stroke-width:1.6}"
    ".flow{stroke:#333;stroke-width:1.8;fill:none;marker-end:url(#tip)}"
    ".line{stroke:#333;stroke-width:1.8;fill:none}.dot{fill:#333}"
)
TIP = (
    '<marker id="tip" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7"'
    ' orient="auto"><path d="M0 0 10 5 0 10z" fill="#333"/></marker>'
)
ROW, BELOW, BOTTOM = 70, 170, 260
MINUS = "\N{MINUS SIGN}"


def block(x: int, y: int, text: str, kind: str, width: int = 90) -> str:
    """Return a block centred at (x, y)."""
    corner = f'x="{x - width // 2}" y="{y - 24}" width="{width}" height="48" rx="6"'
    return f'<rect class="block {kind}" {corner}/><text x="{x}" y="{y + 6}">{text}</text>'


def junction(x: int, y: int, *signs: tuple[str, int, int]) -> str:
    """Return a summing junction; a sign is its text and where it is from the centre."""
    texts = "".join(
        f'<text class="small" x="{x + dx}" y="{y + dy}">{sign}</text>' for sign, dx, dy in signs
    )
    return f'<circle class="sum" cx="{x}" cy="{y}" r="11"/>{texts}'


def flow(path: str) -> str:
    """Return a line along an SVG path, with an arrow at its end."""
    return f'<path class="flow" d="{path}"/>'


def label(x: int, y: int, text: str) -> str:
    """Return the name of a signal."""
    return f'<text class="small" font-style="italic" x="{x}" y="{y}">{text}</text>'


def dot(x: int, y: int) -> str:
    """Return the point where a signal branches."""
    return f'<circle class="dot" cx="{x}" cy="{y}" r="3.5"/>'


def drawing(title: str, description: str, height: int, *parts: str) -> str:
    """Return the whole picture, 760 wide."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 760 {height}" font-size="17"'
        ' font-family="system-ui, sans-serif" role="img" aria-labelledby="title description">'
        f'\n<title id="title">{title}</title>\n<desc id="description">{description}</desc>'
        f"\n<defs>{TIP}<style>{STYLE}</style></defs>"
        f'\n<rect width="760" height="{height}" fill="#fff"/>'
    )
    return "\n".join([head, *parts, "</svg>", ""])


def chain(controlled: str) -> tuple[str, ...]:
    """Return what all loops share: set point, C, latency, vehicle; ``controlled`` enters below."""
    return (
        label(22, ROW - 12, "0"),
        flow(f"M10 {ROW}H49"),
        junction(62, ROW, ("+", -20, -8), (MINUS, -12, 26)),
        flow(f"M73 {ROW}H118"),
        block(165, ROW, "C", "law"),
        block(450, ROW, "latency", "rig"),
        flow(f"M495 {ROW}H563"),
        block(610, ROW, "vehicle", "rig"),
        flow(f"M655 {ROW}H745"),
        label(735, ROW - 12, "y"),
        dot(690, ROW),
        label(92 if len(controlled) > 1 else 80, ROW + 40, controlled),
    )


def compared(error_sign: str, command_sign: str) -> tuple[str, ...]:
    """Return how an observer compares command and error, each with its sign."""
    return (
        dot(340, ROW),
        flow(f"M340 {ROW}V{BELOW - 26}"),
        block(340, BELOW, "Q", "observer"),
        flow(f"M340 {BELOW + 24}V{BOTTOM - 13}"),
        flow(f"M690 {ROW}V{BOTTOM}H567"),
        block(520, BOTTOM, "Q / Gₙ", "observer"),
        flow(f"M475 {BOTTOM}H353"),
        dot(690, BOTTOM),
        junction(340, BOTTOM, (error_sign, 20, 22), (command_sign, 14, -16)),
    )


def loop() -> str:
    """Return the plain loop."""
    return drawing(
        "The loop",
        "The controller C turns the error into a command; the latency delays it; the vehicle moves;"
        " its lateral error comes back.",
        190,
        *chain("y"),
        flow(f"M210 {ROW}H403"),
        label(300, ROW - 12, "u"),
        flow(f"M690 {ROW}V150H62V{ROW + 13}"),
    )


def dob() -> str:
    """Return the loop with a disturbance observer."""
    return drawing(
        "Disturbance observer",
        "Q/G_n turns the measured error into the command that explains it; Q u, the filtered"
        " command, is subtracted; the difference is subtracted from the demand of C.",
        330,
        *chain("y"),
        flow(f"M210 {ROW}H249"),
        junction(262, ROW, ("+", -20, -8), (MINUS, -12, 26)),
        flow(f"M273 {ROW}H403"),
        label(340, ROW - 12, "u"),
        *compared("+", MINUS),
        flow(f"M329 {BOTTOM}H262V{ROW + 13}"),
        label(285, BOTTOM - 10, "d̂"),
        flow(f"M690 {BOTTOM}V310H62V{ROW + 13}"),
    )


def cdob() -> str:
    """Return the loop with a communication disturbance observer."""
    return drawing(
        "Communication disturbance observer",
        "Q/G_n turns the measured error into the command that explains it and is subtracted from"
        " Q u; G_n turns the difference into an error, which is added to the one fed back.",
        330,
        *chain("y_fb"),
        flow(f"M210 {ROW}H403"),
        label(300, ROW - 12, "u"),
        *compared(MINUS, "+"),
        flow(f"M329 {BOTTOM}H257"),
        label(292, BOTTOM - 10, "d̂ₙ"),
        block(205, BOTTOM, "H Gₙ", "observer"),
        flow(f"M160 {BOTTOM}H75"),
        junction(62, BOTTOM, ("+", 20, -8), ("+", -16, 26)),
        flow(f"M62 {BOTTOM - 11}V{ROW + 13}"),
        flow(f"M690 {BOTTOM}V310H62V{BOTTOM + 13}"),
    )


def ddob() -> str:
    """Return the loop with both observers."""
    return drawing(
        "Both observers",
        "The disturbance observer acts around latency and vehicle; the communication disturbance"
        " observer compares the demand c with the error and corrects the feedback.",
        300,
        *chain("y_fb"),
        flow(f"M210 {ROW}H299"),
        label(245, ROW - 12, "c"),
        junction(312, ROW, ("+", -20, -8), (MINUS, 14, 26)),
        flow(f"M323 {ROW}H403"),
        label(365, ROW - 12, "u"),
        dot(365, ROW),
        flow(f"M365 {ROW}V{BELOW - 26}"),
        block(340, BELOW, "DOB", "observer", 110),
        flow(f"M312 {BELOW - 24}V{ROW + 13}"),
        label(296, BELOW - 50, "d̂"),
        flow(f"M690 {ROW}V{BELOW}H397"),
        dot(245, ROW),
        flow(f"M245 {ROW}V{BOTTOM - 26}"),
        block(245, BOTTOM, "CDOB", "observer", 110),
        flow(f"M690 {BELOW}V{BOTTOM}H302"),
        dot(690, BELOW),
        flow(f"M190 {BOTTOM}H62V{ROW + 13}"),
    )


PICTURES = {"loop": loop, "dob": dob, "cdob": cdob, "ddob": ddob}


def main(folder: Path) -> None:
    """Write every picture."""
    for name, picture in PICTURES.items():
        (folder / f"course_{name}.svg").write_text(picture(), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
