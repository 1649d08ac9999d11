// Verify, optimise, sweep, report: as jobs that outlive the page, and what came of them.

import { signal } from "@preact/signals";
import { key, type Refusal, send } from "../api";
import { cancel, forget, loadResult, results, type Run, runs, start, startProblem, unfinished } from "../jobs";
import { design, differences, edit, gesture, type Json, open, parse, text } from "../state";
import { brief, duration, mm, percent, VERDICTS } from "../words";

const axis = signal(""), from = signal("0.1"), to = signal("1"), count = signal("5");

function numericPaths(part: Json, path: string[] = []): string[] {
  if (typeof part === "number") return [`/${path.join("/")}`];
  if (part === null || typeof part !== "object") return [];
  return Object.entries(part).flatMap(([name, value]) => (path.length === 0 && name === "optimise" ? [] : numericPaths(value, [...path, name])));
}

export function Runs() {
  const ready = Boolean(design.value);
  return (
    <>
      <div class="controls" role="group" aria-label="Run">
        <button type="button" disabled={!ready} onClick={() => start("verification", "/v1/verifications", "Verify by Monte Carlo", { precision: 0.005 })}>Verify by Monte Carlo</button>
        <button type="button" disabled={!ready || !design.value?.optimise} title={design.value?.optimise ? "" : "the design has no optimise section: add one under all fields"} onClick={() => start("optimisation", "/v1/optimisations", "Optimise", {})}>Optimise</button>
        <button type="button" disabled={!ready} onClick={() => start("report", "/v1/reports", "Report", { precision: 0.005 })}>Write the report</button>
      </div>
      <details>
        <summary>Sweep one number</summary>
        <form class="controls" onSubmit={(event) => {
          event.preventDefault();
          void start("sweep", "/v1/sweeps", `Sweep ${axis.value}`, { axes: [{ pointer: axis.value, start: Number(from.value), stop: Number(to.value), count: Number(count.value) }] });
        }}>
          <label>Number{" "}
            <select value={axis.value} required onChange={(event) => (axis.value = event.currentTarget.value)}>
              <option value="">choose …</option>
              {numericPaths(design.value).slice(0, 400).map((p) => <option key={p}>{p}</option>)}
            </select>
          </label>
          {([["from", from], ["to", to], ["points", count]] as const).map(([name, value]) => (
            <label key={name}>{name} <input type="text" inputMode="decimal" size={6} required value={value.value} onInput={(event) => (value.value = event.currentTarget.value)} /></label>
          ))}
          <button type="submit">Sweep</button>
        </form>
      </details>
      {startProblem.value && <Problem problem={startProblem.value} />}
      {runs.value.length === 0 && <p class="note">No runs yet. What is run here goes on when the page is closed, and is found again.</p>}
      <ol class="runs" aria-label="Runs of this page">{runs.value.map((run) => <Item key={run.id} run={run} />)}</ol>
    </>
  );
}

function Problem({ problem }: { problem: Refusal }) {
  return (
    <div class="problems" role="alert">
      <p><strong>{problem.title}</strong></p>
      <ul>{problem.errors.slice(0, 5).map((e) => <li key={e.pointer + e.detail}>{e.pointer && <code>{e.pointer}</code>} {e.detail} <span class="note">{e.hint}</span></li>)}</ul>
    </div>
  );
}

function Item({ run }: { run: Run }) {
  const result = run.result ? results.value[run.result] : null;
  if (run.result && !result) void loadResult(run.result);
  const other = run.text !== text.value;
  return (
    <li class="run" data-kind={run.kind} data-state={run.state}>
      <p class="head">
        <strong>{run.title}</strong> <span class="note">{new Date(run.begun).toLocaleTimeString()}{other ? ", of an earlier state of the design" : ""}</span>
        <span class={`status ${run.state}`}>{run.state}</span>
        {unfinished(run)
          ? <button type="button" class="small" onClick={() => cancel(run.id)}>Cancel</button>
          : <button type="button" class="small" onClick={() => forget(run.id)}>Take off the list</button>}
        {other && <button type="button" class="small" onClick={() => open(run.text, `Back to the design of ${run.title}`)}>Back to that design</button>}
      </p>
      {unfinished(run) && (
        <>
          <progress max={1} value={run.fraction} aria-label={`${run.title}: progress`} />
          <p class="note">{`${percent(run.fraction, 0)}${run.eta !== null ? `, about ${duration(run.eta)} left` : ""}${run.note ? `: ${run.note}` : ""}`}</p>
        </>
      )}
      {run.problem && <Problem problem={run.problem} />}
      {result && <Outcome run={run} result={result} />}
      {run.result && <Reports sha256={run.result} kind={run.kind} />}
    </li>
  );
}

function Outcome({ run, result }: { run: Run; result: Json }) {
  if (run.kind === "verification") return <Verified result={result} />;
  if (run.kind === "optimisation") return <Optimum run={run} result={result} />;
  if (run.kind === "sweep") return <Swept result={result} />;
  return null;
}

function Verified({ result }: { result: Json }) {
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label="Verification">
      <p>{`${VERDICTS[result.verdict.status] ?? result.verdict.status}: ${result.trials.toLocaleString("en")} trials of the whole chain. `}<span class="note">{result.stopping}</span></p>
      <table>
        <thead><tr><th>Target</th><th class="number">P95, mm</th><th class="number">95 % interval, mm</th><th class="number">First order, mm</th><th class="number">Worst seen, mm</th><th class="number">Over the limit</th></tr></thead>
        <tbody>
          {result.targets.slice(0, 200).map((t: Json) => (
            <tr key={t.name}><th>{t.name}</th><td class="number">{mm(t.p95_mm)}</td><td class="number">{t.p95_interval_mm.map((v: number) => mm(v)).join(" to ")}</td>
              <td class="number">{mm(t.first_order_p95_mm)}</td><td class="number">{mm(t.worst_mm)}</td><td class="number">{percent(t.exceedance?.probability ?? null, 2)}</td></tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

function Optimum({ run, result }: { run: Run; result: Json }) {
  const known = result.status === "optimal" || result.design;
  const accept = () => {
    const changed = differences(parse(run.text).data, result.design);
    const now = parse(text.value).data, wanted = differences(now, result.design);
    gesture.value = [];
    edit(wanted.length ? wanted : changed, "Accept the optimum");
  };
  return (
    <>
      <p>{`${result.status}: P95 ${mm(result.p95_before_mm)} → ${mm(result.p95_after_mm)} mm; cost ${brief(result.cost_before)} → ${brief(result.cost_after)}.`}</p>
      <div class="scroll" tabIndex={0} role="region" aria-label="What changes">
        <table>
          <thead><tr><th>What changes</th><th class="number">before</th><th class="number">after</th></tr></thead>
          <tbody>
            {result.moved.slice(0, 100).map((m: Json) => <tr key={m.label}><th>{m.label}</th><td class="number">{point(m.before_mm)}</td><td class="number">{point(m.after_mm)}</td></tr>)}
            {result.tolerances.slice(0, 100).map((t: Json) => <tr key={t.contributor + t.component}><th>{(t.label || t.contributor).endsWith(` ${t.component}`) ? t.label || t.contributor : `${t.label || t.contributor} ${t.component}`}</th><td class="number">{`${brief(t.before_half_width)} ${t.unit.replace("deg", "°")}`}</td><td class="number">{`${brief(t.after_half_width)} ${t.unit.replace("deg", "°")}${t.grade ? `, ${t.grade}` : ""}`}</td></tr>)}
          </tbody>
        </table>
      </div>
      {known && <p><button type="button" onClick={accept}>Take this design (undo brings yours back)</button></p>}
    </>
  );
}

const point = (p: number[] | null) => (p ? `${p.map((v) => v.toFixed(2)).join(", ").replace(/-/g, "−")} mm` : "–");

function Swept({ result }: { result: Json }) {
  const points: Json[] = result.points ?? [], values = points.map((p) => p.targets?.map((t: Json) => t.p95_mm)?.[0] ?? null);
  const good = values.filter((v): v is number => v !== null), top = Math.max(...good, 1e-9);
  const at = (p: Json, k: number) => (Array.isArray(p.values) ? p.values[0] : Object.values(p.values ?? {})[0] ?? k);
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label="Sweep">
      <table>
        <thead><tr><th>Value</th><th class="number">P95, mm</th><th>of the largest</th></tr></thead>
        <tbody>
          {points.slice(0, 200).map((p, k) => (
            <tr key={k}><th>{String(at(p, k))}</th><td class="number">{mm(values[k])}</td>
              <td>{values[k] !== null && <svg class="bar" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect y="1" width={(100 * values[k]!) / top} height="8" /></svg>}</td></tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Reports are links; with a key they are fetched with it and opened from memory. */
function Reports({ sha256, kind }: { sha256: string; kind: string }) {
  const forms = kind === "verification" || kind === "optimisation" || kind === "report" || kind === "sweep" ? ["html", "pdf", "xlsx", "json"] : ["json"];
  const path = (form: string) => `v1/results/${sha256}/report?format=${form}`;
  const fetched = async (event: Event, form: string) => {
    if (!key.value) return;
    event.preventDefault();
    const response = await send("GET", `/${path(form)}`);
    if (response.ok) save(await response.blob(), `report.${form}`);
  };
  return (
    <p class="note">Report: {forms.map((form) => (
      <a key={form} href={path(form)} target={form === "html" ? "_blank" : undefined} rel="noopener" download={form === "html" ? undefined : `report.${form}`} onClick={(event) => fetched(event, form)}>{form.toUpperCase()}</a>
    )).flatMap((link, k) => (k ? [" · ", link] : [link]))}</p>
  );
}

export function save(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  window.setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
