// A thousand designs at once: drawn, scored, brushed, taken.  See tests/service/test_workbench_many.py.
import { ASKED_AGAIN, asked, axe, begun, current, downloaded, drawn, faded, newContext, number, part, state, tell, wide } from "./page.mjs";

const scenarios = {}, TITLE = "Many designs at once";

/** The part of the page, with as many designs as are asked for, or what stands there instead. */
async function opened(page, count = asked.count) {
  const many = await part(page, TITLE);
  await many.getByRole("button", { name: /^Score \d/ }).waitFor();
  if (count) await number(many, "how many designs", String(count));
  return many;
}
const score = async (many, count = asked.count) => {
  await many.getByRole("button", { name: /^Score \d/ }).click();
  await many.getByText(`${count} of ${count} designs`).waitFor();
};
const kept = (many) => many.locator("strong[role=status]").innerText();
const csv = async (page, many) => {
  const [file] = await Promise.all([page.waitForEvent("download"), many.getByRole("button", { name: "Save as CSV" }).click()]);
  return String(await downloaded(file));
};
const ends = (many, name) => Promise.all(["from", "up to"].map((end) => many.getByLabel(`keep ${name} ${end}`, { exact: true }).inputValue()));

// By typed numbers alone: a sample, what is kept of it, one that is taken, and back
scenarios.typed = async () => {
  const page = await begun(await newContext()), found = {}, many = await opened(page);
  await score(many);
  found.first = await kept(many);
  await number(many, "keep cost up to", String(asked.cost));
  await number(many, "keep P95 of tip-accuracy up to", String(asked.p95));
  found.kept = await kept(many);
  found.csv = await csv(page, many);
  await many.getByRole("button", { name: "cost", exact: true }).focus();
  await page.keyboard.press("Enter");
  found.sorted = await many.locator("th[aria-sort]").getAttribute("aria-sort");
  const before = await state(page), names = () => many.getByRole("region", { name: "Axes", exact: true }).locator("tbody th").allInnerTexts();
  found.axes = [await names()];
  await many.getByRole("button", { name: /^Take \d/ }).first().press("Enter");
  await current(page);
  const after = await state(page);
  Object.assign(found, { steps: after.steps - before.steps, text: after.text, p95: after.score.targets[0].p95_mm, present: await many.locator("path.present").count(), old: await many.locator(".old").count() });
  found.axes.push(await names());
  found.now = await many.getByRole("region", { name: "Axes", exact: true }).locator("tr", { hasText: "cost" }).locator("td").first().innerText();
  await faded(page);
  if (asked.axe) found.axe = await axe(page);
  await page.keyboard.press("Control+z");
  found.undone = (await state(page)).text === before.text;
  return found;
};

// By the pointer: along an axis, at the limit, on a line; then something else changes
scenarios.pointer = async () => {
  const page = await begun(await newContext()), found = {}, many = await opened(page);
  await score(many);
  await many.getByRole("button", { name: "Keep all" }).click();
  const field = many.locator(".many svg"), of = (name) => many.locator(".many .axis").nth(name);
  const grip = async (k) => { await of(k).scrollIntoViewIfNeeded(); const { x, y, width, height } = await of(k).locator(".grip").boundingBox(); return [x + width / 2, y, height]; };
  const drag = async (k, from, to) => {
    const [x, y, height] = await grip(k);
    await page.mouse.move(x, y + from * height);
    await page.mouse.down();
    await page.mouse.move(x + 3, y + to * height, { steps: 4 });
    await page.mouse.up();
    await drawn(page);
  };
  const last = (await many.locator(".many .axis").count()) - 1, shot = () => many.locator("canvas").first().evaluate((canvas) => canvas.toDataURL());
  found.all = await kept(many);
  const whole = await shot();
  await drag(0, 0.25, 0.75);
  found.middle = [await ends(many, asked.axis), await kept(many), (await shot()) !== whole];
  const limit = await of(last).locator(".limit").evaluate((line) => Number(/ (-?[\d.]+)h/.exec(line.getAttribute("d"))[1]) / 230);
  await drag(last, 0.999, limit + 0.01);
  found.limit = [await ends(many, "P95 of tip-accuracy"), await kept(many)];
  const [x, y, height] = await grip(0);
  await page.mouse.click(x, y + height / 2);
  found.pressed = [await ends(many, asked.axis), await kept(many)];
  const next = (await grip(1))[0], steps = (await state(page)).steps;
  for (let k = 1; k < 20 && (await many.locator("path.near").count()) === 0; k += 1) {
    await page.mouse.move((x + next) / 2, y + (k / 20) * height);
    await drawn(page);
  }
  found.near = await many.locator("p.near").innerText();
  await page.mouse.down();
  await page.mouse.up();
  await current(page);
  found.taken = [(await state(page)).steps - steps, (await state(page)).score.targets[0].p95_mm, await many.locator(".old").count()];
  if (asked.shot) await page.screenshot({ path: asked.shot });
  await number(page, "F2 x, mm", "31");
  await current(page);
  await faded(page);
  found.other = [await many.locator(".old").count(), await many.getByText("something else than what varies").count(), await many.getByRole("button", { name: /^Take \d/ }).first().isDisabled(), await axe(page)];
  await field.scrollIntoViewIfNeeded();
  return found;
};

// Places of a target as axes, a narrow screen, and what cannot be scored
scenarios.where = async () => {
  const page = await begun(await newContext({ viewport: { width: 390, height: 844 }, hasTouch: true })), found = {}, many = await opened(page);
  for (let rows = many.locator("button", { hasText: "×" }); await rows.count(); await drawn(page)) await rows.first().click();
  found.none = await many.getByText("Nothing varies: choose an axis.").count();
  for (const axis of asked.axes) await many.getByLabel("Let vary, too").selectOption({ label: `${axis}, mm` });
  await number(many, `draw ${asked.axes[0]} up to`, String(asked.far));
  await score(many);
  await many.getByRole("button", { name: "Keep all" }).click();
  found.csv = await csv(page, many);
  found.map = await many.locator(".where canvas").evaluate((canvas) => [...canvas.getContext("2d").getImageData(0, 0, 300, 300).data].filter((value, k) => k % 4 === 3 && value > 0).length / 90000);
  found.caption = await many.locator(".where figcaption").innerText();
  found.whys = await many.getByText("could not be scored").allInnerTexts();
  await faded(page);
  found.axe = await axe(page);
  found.wide = await wide(page);
  await number(many, "how many designs", "many");
  found.wrong = await many.getByLabel("how many designs").getAttribute("aria-invalid");
  if (asked.shot) await page.screenshot({ path: asked.shot });
  return found;
};

// The service is killed in the middle of a sample; then the design changes in the middle of another
scenarios.killed = async () => {
  const page = await begun(await newContext()), found = {}, many = await opened(page);
  await many.getByRole("button", { name: /^Score \d/ }).click();
  await many.locator("progress").waitFor();
  tell({ said: "kill" });
  await many.getByText("The service does not answer").waitFor();
  tell({ said: "told" });
  await many.getByText(`${asked.count} of ${asked.count} designs`).waitFor();
  found.problems = await many.locator(".problems").count();
  await current(page);
  await many.getByRole("button", { name: /^Score \d/ }).click();
  await many.locator("progress").waitFor();
  await number(page, "F2 x, mm", "31");
  await many.getByText("; stopped").waitFor();
  found.stopped = [await many.locator(".old").count(), await many.locator("progress").count()];
  return found;
};

// What is asked and then given up: its answer has begun to come, and is read once nobody waits for it
scenarios.left = async () => {
  const context = await newContext();
  await context.addInitScript(() => {
    const ask = window.fetch;
    window.coming = 0;
    window.fetch = async (where, more) => {
      const response = await ask(where, more), read = response.arrayBuffer.bind(response), left = more?.signal;
      if (left) response.arrayBuffer = async () => {
        window.coming += 1;
        await new Promise((done) => (left.aborted ? done() : left.addEventListener("abort", done)));
        return read();
      };
      return response;
    };
  });
  const page = await begun(context), coming = (count) => page.waitForFunction((most) => window.coming >= most, count, ASKED_AGAIN);
  await coming(2); // how near the design is to the best, and its limit
  await number(page, "F2 x, mm", "31");
  await current(page);
  const found = { rest: await page.evaluate(() => window.coming) }, many = await opened(page, 5000);
  await many.getByRole("button", { name: /^Score \d/ }).click();
  await coming(found.rest + 2);
  await number(page, "F2 x, mm", "30");
  await many.getByText("; stopped").waitFor();
  await current(page);
  await drawn(page);
  return found;
};

export default scenarios;
