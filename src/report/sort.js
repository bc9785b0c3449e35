"use strict";
// Tables sort by their columns; without this script they are read as they are.
const leading = (text) => {
  const found = text.trim().match(/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?/i);
  return found ? Number(found[0]) : NaN;
};
const compare = (a, b) => {
  const [x, y] = [leading(a), leading(b)];
  if (Number.isNaN(x) || Number.isNaN(y)) {
    // What is no number stands behind those that are.
    return Number.isNaN(x) && Number.isNaN(y) ? a.localeCompare(b) : Number.isNaN(x) - Number.isNaN(y);
  }
  return x - y;
};
for (const table of document.querySelectorAll("table.sort")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const way = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", way === 1 ? "ascending" : "descending");
      const rows = [...table.tBodies[0].rows];
      const text = (row) => row.cells[column]?.textContent ?? "";
      rows.sort((a, b) => way * compare(text(a), text(b)));
      table.tBodies[0].append(...rows);
    });
  });
}
