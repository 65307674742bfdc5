// JSON that takes a while to be made: asked for again until it is there, with what to say meanwhile.

export async function fetched(address, waiting) {
  for (;;) {
    let answer;
    try {
      answer = await fetch(address, { headers: { accept: "application/json" } });
    } catch {
      waiting("The dashboard cannot be reached; trying again.");
      await new Promise((done) => setTimeout(done, 3000));
      continue;
    }
    const isJson = answer.headers.get("content-type")?.startsWith("application/json");
    const body = isJson ? await answer.json() : { title: "The service does not answer", text: "Trying again." };
    if (answer.status === 200) return body;
    const again = answer.headers.get("retry-after") ?? (answer.status === 503 ? "3" : null);
    if (again === null) throw new Error(`${body.title}. ${body.text}`);
    waiting(`${body.title} …`);
    await new Promise((done) => setTimeout(done, 1000 * Number(again)));
  }
}
