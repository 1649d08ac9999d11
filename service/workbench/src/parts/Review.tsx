// What a review leaves in the design: versions of it by name, two of them on one scale, and comments.

import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { answer, current, placeInWords, type Score, send } from "../api";
import { runs, start, unfinished } from "../jobs";
import { BY, type Change, changes, known, type Known, read, type Reading, simulationOf, spread } from "../readings";
import { comments, contentOf, design, differences, type Json, keepVersion, now as today, parse, pointerOf, recall, remember, removeVersion, say, selected, setComments, takeState, text, valueAt, type Version, versions } from "../state";
import { changed, mm, stated, VERDICTS } from "../words";
import { Dots, isDrawn } from "./Dots";
import { beads, ghost } from "./Pictures";
import { shownComment } from "./Pin";
import { fileName, Reports, saveAnswer } from "./Reports";
import { Table } from "./Words";

// --- versions ---------------------------------------------------------------------------------------------------------------

const scored = signal<Record<string, Reading<"estimate"> | null>>({}); // by text; null: it has no answer

async function scoreOf(source: string): Promise<void> {
  const response = await send("POST", "/v1/scores", { design: parse(source).data, fifty_shots: true }).catch(() => null);
  scored.value = { ...scored.value, [source]: response?.ok ? read<"estimate">((await response.json()) as Score) : null };
}

export function Versions() {
  const [compared, compare] = useState<string | null>(null), [against, setAgainst] = useState("");
  for (const version of versions.value) if (!(version.text in scored.value) && current.value) void once(version.text); // not beside a score of the design
  const chosen = versions.value.find((v) => v.name === compared), other = versions.value.find((v) => v.name === against && v !== chosen), now = current.value ? known.value : { estimate: null, simulation: null };
  const keep = (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement, [wanted, note] = ["name", "note"].map((field) => String(new FormData(form).get(field) ?? "").trim());
    const name = keepVersion(wanted, note);
    if (name === null) return void say(`There is a version ${wanted} already, or as many as are kept: take one away, or name it otherwise.`, true);
    const kept = versions.value.find((version) => version.name === name)!;
    if (now.estimate) scored.value = { ...scored.value, [kept.text]: now.estimate };
    form.reset();
    say(`Kept as version ${name}: it goes with the file and the link.`);
  };
  const open = async (file: File | undefined) => {
    if (!file) return;
    const source = await file.text(), { errors } = parse(source);
    const name = errors.length ? null : keepVersion(file.name.replace(/\.(ya?ml|json)$/i, "").slice(0, 80), "", source);
    if (name) compare(name);
    else say(errors.length ? `${file.name} holds no design: ${errors[0].message}` : `There is a version of that name already.`, true);
  };
  return (
    <>
      <form class="controls" aria-label="Keep a version" onSubmit={keep}>
        <label>Name <input name="name" type="text" size={6} maxLength={80} placeholder="next letter" /></label>
        <label>Note <input name="note" type="text" size={18} maxLength={2000} /></label>
        <button type="submit">Keep this design as a version</button>
        <label class="button">Compare with a file<input type="file" class="hidden" accept=".yaml,.yml,.json" onChange={(event) => { void open(event.currentTarget.files?.[0]); event.currentTarget.value = ""; }} /></label>
      </form>
      {versions.value.length > 0 && (
        <Table name="Versions" caption="The requirement that decides of each; differences are of estimates, and of simulations with the same random numbers" head={<><th>Version</th><th>Status</th><th class="number">Estimate</th><th class="number">Simulated</th><th class="number">Limit</th><th>What decides; use</th></>}>
          <tr><th>now</th><Judged of={now} /></tr>
          {versions.value.map((version) => {
            const estimate = scored.value[version.text], of = estimate === undefined ? undefined : { estimate, simulation: simulationOf(estimate?.sha) };
            return (
              <tr key={version.name}>
                <th title={[version.date, version.note].filter(Boolean).join(": ")}>{version.name}{version.note && <span class="note">{` ${version.note}`}</span>}</th>
                <Judged of={of} now={now}>
                  <label><input type="checkbox" aria-label={`Draw ${version.name} below`} checked={ghost.value === version.name} onChange={(event) => (ghost.value = event.currentTarget.checked ? version.name : null)} />draw</label>
                  <button type="button" class="small" aria-pressed={compared === version.name} onClick={() => compare(compared === version.name ? null : version.name)}>compare</button>
                  <button type="button" class="small" onClick={() => takeState(version.text, `Version ${version.name}`)}>take</button>
                  <button type="button" class="small" aria-label={`Remove version ${version.name}`} onClick={() => removeVersion(version.name)}>×</button>
                </Judged>
              </tr>
            );
          })}
        </Table>
      )}
      {chosen && versions.value.length > 1 && (
        <p><label>{`${chosen.name} against `}<select value={other?.name ?? ""} onChange={(event) => setAgainst(event.currentTarget.value)}><option value="">now</option>{versions.value.filter((each) => each !== chosen).map(({ name }) => <option key={name}>{name}</option>)}</select></label></p>
      )}
      {chosen && <Pair first={chosen} second={other} now={now.estimate} />}
    </>
  );
}

/** Two designs: dots, budget and fields, each on one scale; and as one report. */
function Pair({ first, second, now }: { first: Version; second: Version | undefined; now: Reading<"estimate"> | null }) {
  const readings = [scored.value[first.text], second ? scored.value[second.text] : now], names = [first.name, second?.name ?? "now"], title = `${names[0]} against ${names[1]}`;
  const before = bareOf(first.text), after = second ? bareOf(second.text) : design.value, rows = differences(before, after);
  const content = contentOf(second?.text ?? text.value), run = runs.value.find((each) => each.title === title && each.report && contentOf(each.text) === content), told = [first.text, second?.text ?? ""].join();
  const [made, make] = useState<{ of: string; path: string } | null>(null), [busy, wait] = useState(false);
  if (!rows.length) return <p>{`${names[1]} is the same design as ${names[0]}.`}</p>;
  const request = { first: before, second: after, names };
  const report = async () => {
    wait(true);
    say("Both designs are being scored.");
    const response = await send("POST", "/v1/comparisons", { ...request, parts: ["score"] }, { Prefer: "wait=60" }).catch(() => null);
    const path = response?.status === 200 ? response.headers.get("Content-Location") : null;
    wait(false);
    if (!path) return void start(title, "/v1/comparisons", { ...request, parts: ["score"] }); // which says why not, or goes on as a job
    make({ of: told, path: `${path}/report` });
    await saveAnswer("GET", `${path}/report?format=pdf`, undefined, {}, `${fileName()}.${fileName(title)}.pdf`, "The report");
  };
  const brief = (value: Json) => (value === undefined ? "–" : JSON.stringify(value).slice(0, 60));
  return (
    <section aria-label={title}>
      <Dots rows={readings.map((of, k) => ({ name: names[k], shots: of?.record.fifty_shots })).filter(isDrawn)} />
      {readings[0] && readings[1] && <Budgets names={names} readings={readings as Reading<"estimate">[]} />}
      <p class="controls">
        <button type="button" disabled={busy} onClick={report}>{`Report: ${title}, PDF`}</button>
        <button type="button" disabled={!current.value || runs.value.some(unfinished)} onClick={() => start(title, "/v1/comparisons", { ...request, precision: 0.005 })}>Simulate the difference</button>
        <span class="note">both with the same random numbers; what comes of it stands under Run</span>
        {made?.of === told && <span class="note">By estimate: <Reports path={made.path} of={title} /></span>}
        {run && <span class="note">Simulated: <Reports path={run.report!} of={title} /></span>}
      </p>
      <Table name={`Differences from version ${first.name}`} head={<><th>Field</th><th class="number">{names[0]}</th><th class="number">{names[1]}</th></>}>
        {rows.slice(0, 100).map((row) => <tr key={pointerOf(row.path)}><th>{placeInWords(after, pointerOf(row.path))}</th><td class="number">{brief(valueAt(before, row.path))}</td><td class="number">{brief(row.value)}</td></tr>)}
      </Table>
    </section>
  );
}

/** A text as a design, without what a review left in it. */
function bareOf(source: string): Json {
  const { review, ...rest } = parse(source).data ?? {};
  return rest;
}

/** What each contributor moves the target by, by itself: of two designs beside one another. */
function Budgets({ names, readings }: { names: string[]; readings: Reading<"estimate">[] }) {
  const of = readings.map(({ target }) => new Map(target.contributors.filter(({ component, law }) => component === "all" && law !== "known").map((line) => [line.name, { label: line.label || line.name, size: spread(target, line.variance_share) }])));
  const most = Math.max(1e-9, ...of.flatMap((each) => [...each.values()].map(({ size }) => size))), d = readings[1].decimals;
  const keys = [...new Set(of.flatMap((each) => [...each.keys()]))].sort((a, b) => Math.max(...of.map((each) => each.get(b)?.size ?? 0)) - Math.max(...of.map((each) => each.get(a)?.size ?? 0))).slice(0, 12);
  return (
    <Table name="Budgets side by side" of="budget" kind="estimate" caption={`What each source moves ${[...new Set(readings.map(({ target }) => target.name))].join(", ")} by, by itself: root mean square, mm, by estimate`} head={<><th>Contributor</th>{names.map((name) => <th key={name} class="number">{name}</th>)}</>}>
      {keys.map((key) => (
        <tr key={key}><th>{of[1].get(key)?.label ?? of[0].get(key)?.label}</th>{of.map((each, k) => (
          <td key={names[k]} class="number share"><svg class="bar" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect width={(100 * (each.get(key)?.size ?? 0)) / most} height="10" /></svg>{each.has(key) ? mm(each.get(key)!.size, d) : "–"}</td>
        ))}</tr>
      ))}
    </Table>
  );
}

function Judged({ of, now, children }: { of: Known | undefined; now?: Known; children?: ComponentChildren }) {
  const shown = of?.simulation ?? of?.estimate, decides = shown?.decides, by = of && now && changes(of, now);
  const cell = (reading: Reading<"estimate"> | Reading<"simulation"> | null | undefined, change: Change | null | undefined) => (
    <td class="number" data-kind={reading?.kind}>{reading ? `${mm(reading.value, reading.digits)} ${reading.unit}` : of ? "–" : "…"}{change && <span class={change.to < change.from ? "delta less" : "delta more"}>{` ${changed(change.to - change.from, change.decimals)}`}</span>}</td>
  );
  return (
    <>
      <td class={`status ${shown?.record.verdict.status ?? ""}`}>{shown ? VERDICTS[shown.record.verdict.status] ?? shown.record.verdict.status : of ? VERDICTS["not-evaluated"] : ""}{shown && ` ${BY[shown.kind]}`}</td>
      {cell(of?.estimate, by?.estimate)}{cell(of?.simulation, by?.simulation)}<td class="number">{decides && shown ? `${stated(decides.limit, shown.digits)} ${decides.unit}` : "–"}</td>
      <td class="decides">{decides ? `${decides.requirement} at ${decides.target}: ${decides.headline}` : shown ? "no requirement: the largest P95" : ""}{children && <span class="uses"><br />{children}</span>}</td>
    </>
  );
}

const asked = new Set<string>();
async function once(source: string): Promise<void> {
  if (asked.has(source)) return;
  asked.add(source);
  await scoreOf(source);
}

// --- comments ---------------------------------------------------------------------------------------------------------------

const AUTHOR = "tailstack.workbench.author";
const pinOf = ({ bead, contributor, component }: Json): Json => (bead !== undefined ? { bead } : contributor !== undefined ? { contributor, ...(component !== undefined && { component }) } : {});
const pinWords = ({ bead, contributor, component }: Json) => (bead !== undefined ? `bead ${bead}` : contributor !== undefined ? [contributor, component].filter(Boolean).join(" ") : "the design");

export function Comments() {
  const list = useRef<HTMLOListElement>(null), wanted = shownComment.value;
  useEffect(() => {
    if (wanted === null) return;
    list.current?.children[wanted]?.querySelector("button")?.focus(); // which brings it into sight
    shownComment.value = null;
  }, [wanted]);
  const [edited, editing] = useState<number | null>(null), all = comments.value, comment = edited === null ? null : all[edited];
  const lines = (answer.value?.score.targets[0]?.contributors ?? []).filter(({ law }) => law !== "known").map(({ name, component }) => ({ contributor: name, ...(component !== "all" && { component }) }));
  const pins: Json[] = [{}, ...beads.value.map(({ label }) => ({ bead: label })), ...lines], key = (pin: Json) => JSON.stringify(pinOf(pin));
  const own = comment ? pinOf(comment) : selected.value !== null ? { bead: selected.value } : {};
  if (!pins.some((pin) => key(pin) === key(own))) pins.push(own);
  const change = (k: number, fields: Json, what: string) => setComments(all.map((each, at) => (at === k ? { ...each, ...fields } : each)), what);
  const take = (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement, [pin, said, author] = ["pin", "text", "author"].map((field) => String(new FormData(form).get(field) ?? ""));
    if (!said.trim()) return;
    remember(AUTHOR, author);
    const made = { ...JSON.parse(pin), text: said.trim(), ...(author.trim() && { author: author.trim() }), date: today() };
    setComments(comment ? all.map((each, k) => (k === edited ? { ...made, ...(each.resolved && { resolved: true }) } : each)) : [...all, made], comment ? "Change a comment" : `Comment on ${pinWords(made)}`);
    editing(null);
    form.reset();
  };
  return (
    <>
      {all.length > 0 && (
        <ol class="comments" aria-label="Comments" ref={list}>
          {all.map((each, k) => (
            <li key={k} class={each.resolved ? "resolved" : ""}>
              <p class="head"><strong>{pinWords(each)}</strong> <span class="note">{[each.author, each.date?.replace("T", " ").replace("Z", " UTC"), each.resolved && "resolved"].filter(Boolean).join(", ")}</span></p>
              <p class="said" dir="auto">{String(each.text ?? "")}</p>
              <p class="controls">
                {each.bead !== undefined && <button type="button" class="small" onClick={() => (selected.value = each.bead)}>show</button>}
                <button type="button" class="small" onClick={() => change(k, { resolved: each.resolved ? undefined : true }, each.resolved ? "Open a comment again" : "Resolve a comment")}>{each.resolved ? "open again" : "resolve"}</button>
                <button type="button" class="small" onClick={() => editing(k)}>edit</button>
                <button type="button" class="small" aria-label={`Delete comment ${k + 1}`} onClick={() => { editing(null); setComments(all.filter((_, at) => at !== k), "Delete a comment"); }}>×</button>
              </p>
            </li>
          ))}
        </ol>
      )}
      <form key={`${edited} ${key(own)}`} class="comment" aria-label={comment ? "Change the comment" : "A comment"} onSubmit={take}>
        <label>On <select name="pin" defaultValue={key(own)}>{pins.map((pin) => <option key={key(pin)} value={key(pin)} selected={key(pin) === key(own)}>{pinWords(pin)}</option>)}</select></label>
        <label>By <input name="author" type="text" size={12} maxLength={80} defaultValue={comment?.author ?? recall(AUTHOR, "")} /></label>
        <label class="hidden" for="comment-text">Comment</label>
        <textarea id="comment-text" name="text" rows={2} maxLength={2000} required defaultValue={comment?.text ?? ""} placeholder="What is to be said" />
        <button type="submit">{comment ? "Change it" : "Comment"}</button>{comment && <button type="button" onClick={() => editing(null)}>Leave it</button>}
      </form>
    </>
  );
}
