"""Makes glyphs.png and glyphs.txt from DejaVu Sans: python3 make.py FOLDER_OF_THE_TTF_FILES (needs Pillow).

glyphs.png: coverage 0..255, one row of cells per font; a cell is PAD + advance + PAD pixels wide.
glyphs.txt: first line the characters; then per font: face, size, ascent, row height, and the advance of each character.
"""

import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

PAD = 5
CHARACTERS = "".join(map(chr, range(32, 127))) + "µαβγδεθκλμπρσςτφχψωΔΣΩ°±·×−–—′″…≤≥≈∞√√²³¹"
CHARACTERS = "".join(dict.fromkeys(CHARACTERS))
FONTS = [
    ("regular", "DejaVuSans.ttf", [10, 12, 14]),
    ("oblique", "DejaVuSans-Oblique.ttf", [10, 12, 14]),
    ("bold", "DejaVuSans-Bold.ttf", [15]),
]

folder = Path(sys.argv[1])
rows, lines = [], [CHARACTERS]
for face, file, sizes in FONTS:
    for size in sizes:
        font = ImageFont.truetype(str(folder / file), size, layout_engine=ImageFont.Layout.BASIC)
        ascent, descent = font.getmetrics()
        advances = [round(font.getlength(c)) for c in CHARACTERS]
        row = Image.new("L", (sum(advances) + 2 * PAD * len(CHARACTERS), ascent + descent))
        x = 0
        for c, advance in zip(CHARACTERS, advances):
            ImageDraw.Draw(row).text((x + PAD, 0), c, fill=255, font=font)
            x += advance + 2 * PAD
        rows.append(row)
        lines.append(" ".join(map(str, [face, size, ascent, row.height] + advances)))
atlas = Image.new("L", (max(r.width for r in rows), sum(r.height for r in rows)))
y = 0
for row in rows:
    atlas.paste(row, (0, y))
    y += row.height
atlas.save("glyphs.png", optimize=True)
Path("glyphs.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
