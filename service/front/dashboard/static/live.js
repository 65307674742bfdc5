// Keeps a page up to date: its parts are asked for again when the service tells that something has changed.

const LEAST_MS = 1000; // between two askings for one part
const state = new Map(); // part -> {busy, wanted, last, timer}

function parts() {
  return document.querySelectorAll("[data-part]");
}

function ask(part, after = 0) {
  const known = state.get(part) ?? { busy: false, wanted: false, last: 0, timer: 0 };
  state.set(part, known);
  if (known.busy) {
    known.wanted = true;
    return;
  }
  clearTimeout(known.timer);
  const wait = Math.max(after, known.last + LEAST_MS - Date.now(), 0);
  known.timer = setTimeout(() => fetchPart(part, known), wait);
}

async function fetchPart(part, known) {
  if (!part.isConnected) return;
  if (document.hidden) {
    part.dataset.stale = "yes"; // asked for when somebody looks
    return;
  }
  known.busy = true;
  known.wanted = false;
  let again = null;
  try {
    const answer = await fetch(part.dataset.part, { headers: { accept: "text/html" } });
    const html = await answer.text();
    again = answer.headers.get("retry-after");
    const passing = answer.status === 503 && !part.hasAttribute("aria-busy"); // what is shown is better than that
    if (!isPart(answer, html)) show(part, notAPart(part, answer.status));
    else if (!passing) show(part, html);
  } catch {
    again = "3"; // the dashboard itself is not there; the event source says so
  }
  known.busy = false;
  known.last = Date.now();
  if (known.wanted) ask(part);
  else if (again !== null) ask(part, 1000 * Number(again));
}

// A whole page, or what something between here and the dashboard says, is no part of this page.
function isPart(answer, html) {
  return answer.headers.get("content-type")?.startsWith("text/html") && !/^\s*<(!doctype|html)/i.test(html);
}

function notAPart(part, status) {
  return `<div class="note" role="alert"><p><strong>“${part.getAttribute("aria-label")}” cannot be shown</strong>
    (answer ${status}). Load the page again; the dashboard may be another version than this page is of.</p></div>`;
}

function inUse(part) {
  const focus = document.activeElement;
  const typing = focus && part.contains(focus) && focus.matches("input, select, textarea");
  return typing || part.querySelector("details.menu[open]") !== null;
}

function show(part, html) {
  part.removeAttribute("aria-busy");
  if (part.dataset.shown === html) return;
  if (inUse(part)) {
    ask(part, LEAST_MS); // do not take away what somebody uses
    return;
  }
  part.dataset.shown = "";
  const focus = part.contains(document.activeElement) ? document.activeElement.id : "";
  const open = new Set([...part.querySelectorAll("details[open][id]")].map((one) => one.id));
  const checked = new Set([...part.querySelectorAll("input[type=checkbox][id]:checked")].map((one) => one.id));
  const scrolled = new Map([...part.querySelectorAll(".scroll")].map((one, i) => [i, one.scrollLeft]));
  const fresh = document.createElement("template");
  fresh.innerHTML = html;
  part.replaceChildren(fresh.content);
  for (const id of checked) document.getElementById(id)?.toggleAttribute("checked", true);
  for (const id of open) document.getElementById(id)?.setAttribute("open", "");
  part.querySelectorAll(".scroll").forEach((one, i) => (one.scrollLeft = scrolled.get(i) ?? 0));
  if (focus) document.getElementById(focus)?.focus({ preventScroll: true });
  part.dispatchEvent(new CustomEvent("shown", { bubbles: true }));
}

function askAll() {
  for (const part of parts()) ask(part);
}

let since = document.body.dataset.since;
let here = document.getElementById("link").dataset.here;

function tell(now, text, why = "") {
  const link = document.getElementById("link");
  link.dataset.here = now;
  if (link.textContent !== text) link.textContent = text;
  const outage = document.getElementById("outage");
  outage.hidden = now !== "no";
  if (now === "no") document.getElementById("outage-text").textContent = why;
  if (now === "yes" && here === "no") askAll();
  here = now;
}

function listen() {
  const wanted = new URLSearchParams({ since }); // what happened since the page was drawn comes first
  if (document.body.dataset.job) wanted.set("job", document.body.dataset.job);
  const source = new EventSource(`${document.documentElement.dataset.root}/live?${wanted}`);
  source.addEventListener("link", (event) => {
    if (JSON.parse(event.data).here) tell("yes", "Live");
    else tell("no", "No service", "tailroad serve does not run, or cannot be reached.");
  });
  source.addEventListener("all", (event) => {
    since = event.lastEventId;
    askAll();
  });
  source.addEventListener("jobs", (event) => {
    since = event.lastEventId;
    const kinds = new Set(Object.values(JSON.parse(event.data)).flat());
    for (const part of parts()) {
      if (part.dataset.kinds.split(" ").some((kind) => kinds.has(kind))) ask(part);
    }
  });
  source.addEventListener("error", () => {
    tell("no", "No dashboard", "The dashboard itself cannot be reached; trying again.");
    if (source.readyState === EventSource.CLOSED) setTimeout(listen, 3000);
  });
}

document.addEventListener("visibilitychange", () => {
  if (document.hidden) return;
  for (const part of parts()) {
    if (part.dataset.stale) {
      delete part.dataset.stale;
      ask(part);
    }
  }
});

document.addEventListener("change", (event) => {
  event.target.closest("form[data-submit-on-change]")?.requestSubmit();
});

document.addEventListener("submit", (event) => {
  if (!event.target.matches("form[data-once]")) return;
  for (const button of event.target.querySelectorAll("button")) button.disabled = true;
});

document.addEventListener("click", (event) => {
  for (const menu of document.querySelectorAll("details.menu[open]")) {
    if (!menu.contains(event.target)) menu.removeAttribute("open");
  }
});

document.addEventListener("keydown", (event) => {
  if (event.key !== "Escape") return;
  for (const menu of document.querySelectorAll("details.menu[open]")) {
    menu.removeAttribute("open");
    menu.querySelector("summary").focus();
  }
});

window.addEventListener("pageshow", () => {
  for (const button of document.querySelectorAll("form[data-once] button")) button.disabled = false;
});

for (const part of parts()) {
  if (part.dataset.again !== undefined) ask(part, 1000 * Number(part.dataset.again));
}
listen();
