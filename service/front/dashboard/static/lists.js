// Which columns of the list of jobs are shown, kept in this browser.

const KEY = "tailroad-columns-hidden";

function hidden() {
  try {
    return new Set(JSON.parse(localStorage.getItem(KEY) ?? "[]"));
  } catch {
    return new Set(); // no storage here: the choice holds for this page
  }
}

let away = hidden();

function show() {
  const table = document.getElementById("jobs-table");
  if (!table) return;
  for (const box of document.querySelectorAll("[data-column]")) {
    box.checked = !away.has(box.dataset.column);
    table.classList.toggle(`without-${box.dataset.column}`, !box.checked);
  }
}

document.addEventListener("change", (event) => {
  const name = event.target.dataset?.column;
  if (!name) return;
  if (event.target.checked) away.delete(name);
  else away.add(name);
  try {
    localStorage.setItem(KEY, JSON.stringify([...away]));
  } catch {
    // it holds for this page
  }
  show();
});
document.addEventListener("shown", show);
show();
