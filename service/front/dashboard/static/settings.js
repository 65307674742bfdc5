// What a reader sets for this browser: the theme, and whether to be told when a job is over.

const YEAR_S = 31536000;
const root = document.querySelector(".brand").getAttribute("href"); // of this dashboard
const themes = document.getElementById("theme");

themes.addEventListener("change", () => {
  document.documentElement.dataset.theme = themes.value;
  document.cookie = `tailroad-theme=${themes.value}; path=${root}; max-age=${YEAR_S}; samesite=lax`;
  document.dispatchEvent(new CustomEvent("theme"));
});

const TOLD = "tailroad-told";
const over = ["done", "failed", "cancelled", "needs-restart"];
const seen = new Map(); // job -> state on this page

function wanted() {
  try {
    return "Notification" in window && Notification.permission === "granted" && localStorage.getItem(TOLD) === "yes";
  } catch {
    return false;
  }
}

function look() {
  for (const one of document.querySelectorAll("[data-status]")) {
    const { job, status, label } = one.dataset;
    const before = seen.get(job);
    seen.set(job, status);
    if (before === undefined || before === status || over.includes(before) || !over.includes(status)) continue;
    if (wanted()) new Notification(`${label}: ${status}`, { tag: job });
  }
}

const box = document.getElementById("tell");
if ("Notification" in window) {
  box.hidden = false;
  const shown = () => {
    box.textContent = wanted() ? "Notifies when a job is over" : "Notify when a job is over";
    box.setAttribute("aria-pressed", String(wanted()));
  };
  shown();
  box.addEventListener("click", async () => {
    const now = wanted() ? "no" : "yes";
    if (now === "yes" && (await Notification.requestPermission()) !== "granted") {
      box.textContent = "This browser does not allow it";
      return;
    }
    try {
      localStorage.setItem(TOLD, now);
    } catch {
      // without storage nobody is told
    }
    shown();
  });
}
document.addEventListener("shown", look);
look();
