"use strict";
const body = document.querySelector("#summary tbody");
const heads = [...document.querySelectorAll("#summary th")];

function compare(first, second, numbers) {
  if (!numbers) return first.localeCompare(second);
  if (first === "" || second === "") return (first === "") - (second === "");
  return Number(first) - Number(second);
}

heads.forEach((head, column) => head.addEventListener("click", () => {
  const falls = head.getAttribute("aria-sort") === "ascending";
  heads.forEach((other) => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", falls ? "descending" : "ascending");
  const value = (row) => row.children[column].dataset.value;
  const rows = [...body.children].sort((first, second) =>
    (falls ? -1 : 1) * compare(value(first), value(second), head.dataset.kind === "number"));
  body.append(...rows);
}));
