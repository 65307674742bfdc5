// Has the cost of what the form says foretold anew when it says something else.

const form = document.querySelector("form.submit");
const part = document.getElementById("part-forecast");

async function foretell() {
  const wanted = new URLSearchParams();
  for (const name of ["scenario", "ego", "budget"]) wanted.set(name, form.elements[name]?.value ?? "");
  const address = `${part.dataset.part.split("?")[0]}?${wanted}`;
  part.dataset.part = address; // for whoever asks for the part later
  const answer = await fetch(address, { headers: { accept: "text/html" } });
  const html = await answer.text();
  if (answer.ok && part.dataset.part === address) part.innerHTML = html;
}

form.addEventListener("change", () => void foretell().catch(() => {}));
void foretell().catch(() => {});
