// What the numbers say, in a strip that is always in sight.

import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { answer, busy, current, late, refused, type Score, send, trouble } from "../api";
import { loadResult, results, runs, start, unfinished } from "../jobs";
import { advice, START, startOf } from "../advice";
import { canRedo, canUndo, design, edit, gesture, goTo, position, redo, steps, text, undo } from "../state";
import { change, type Check, decimals, decisive, seen, verified } from "../verdicts";
import { brief, changed, decimalsOf, duration, mm, percent, stated, trust, VERDICTS } from "../words";
import { Problems } from "./Problems";
import { ReportLink, takeOptimum } from "./Runs";
import { Term } from "./Words";

const warming = signal(false); // the service says that it is not ready yet
const PATIENCE = 700; // ms without a first score, after which the page asks why

export function Verdict() {
  const score = answer.value?.score, problem = refused.value, old = late.value || (problem !== null && !current.value);
  const simulated = verified.value, verdict = simulated?.verdict ?? score?.verdict, checks: Check[] = verdict?.checks ?? [], d = simulated ? decimalsOf(simulated) : decimals.value;
  const worst = decisive(checks), target = score && (score.targets.find((t) => t.name === worst?.target) ?? score.targets[0]);
  const waits = !score && (problem === null || problem.errors.some(({ rule }) => rule === "warming-up"));
  const status = waits ? "waiting" : problem ? "refused" : verdict?.status ?? "waiting", word = VERDICTS[status] ?? status;
  useEffect(() => {
    if (!waits) return;
    const ask = async () => {
      const ready = await send("GET", "/health/ready").then((response) => response.json()).catch(() => null);
      warming.value = ready?.kernels === "warming up";
    };
    const begin = window.setTimeout(ask, PATIENCE), again = window.setInterval(ask, 2000);
    return () => {
      window.clearTimeout(begin);
      window.clearInterval(again);
      warming.value = false;
    };
  }, [waits]);
  useEffect(() => {
    // what was computed of this very design is known again after a reload
    for (const run of runs.value) if (run.result && run.text === text.value && !results.value[run.result]) void loadResult(run.result).catch(() => null);
  }, [runs.value, text.value]);
  const shade = old ? "old" : "";
  return (
    <section id="verdict" tabIndex={-1} class={`verdict steady ${old && !problem ? "waiting" : status.replace(" ", "-")}`} aria-label="Verdict" data-current={String(current.value && !problem)} data-basis={simulated ? "simulation" : "estimate"}>
      <div class="head">
        <p class={`badge ${old && !problem ? "old" : ""}`}>
          {waits ? (warming.value ? "Warming up" : "…") : problem ? "No answer" : word}
          {score && !problem && <span class="basis"><Term word={simulated ? "verification" : "estimate"} quiet>{simulated ? "verified by simulation" : "by estimate"}</Term></span>}
        </p>
        {target && (
          <dl class={`numbers ${shade}`} data-testid="numbers">
            <div>
              <dt><Term word={!worst || worst.headline === "P95" ? "P95" : "requirement"} quiet>{worst?.headline ?? "P95"}</Term>{` of the error ${!worst || worst.error === "tcp" ? "at the tool" : "as located"}, target ${worst?.target ?? target.name}`}</dt>
              <dd>
                {change.value && <span class="was">{`${mm(change.value.from, d)} → `}</span>}
                <output id="p95" aria-live="off">{mm(worst?.value_mm ?? target.p95_mm, d)}</output> mm
                {change.value && <span class={change.value.by < 0 ? "delta less" : "delta more"}>{` (${changed(change.value.by, d + 1)})`}</span>}
              </dd>
            </div>
            {worst && <div><dt>Between</dt><dd>{interval(worst.interval_mm, d)}</dd></div>}
            {worst && <div><dt><Term word="limit" quiet>Limit</Term></dt><dd>{stated(worst.limit_mm, d)} mm</dd></div>}
            {worst?.yield_fraction != null && <div><dt>Units that meet it</dt><dd>{percent(worst.yield_fraction)}{worst.min_yield != null && ` (asked for: ${percent(worst.min_yield)})`}</dd></div>}
            <div><dt><Term word="bias" quiet>Known bias</Term></dt><dd>{mm(Math.hypot(...target.bias_mm), d)} mm</dd></div>
            <div><dt>Mean error</dt><dd>{mm(target.mean_norm_mm, d)} mm</dd></div>
          </dl>
        )}
      </div>
      <Acts />
      <History />
      <div class="sentence">
        {waits && <p>{warming.value ? "The service is warming up: it loads what it computes with. The first score comes by itself." : "The first score is being computed."}</p>}
        {!waits && trouble.value && <Problems problem={trouble.value} undoable={problem !== null && problem.status !== 0} />}
        {!waits && !trouble.value && score && <div class={`findings ${shade}`}><Findings score={score} /></div>}
      </div>
      <p class="hidden" role="status">{busy.value ? "" : problem ? problem.title : target ? `P95 ${mm(worst?.value_mm ?? target.p95_mm, d)} mm, ${word}, ${simulated ? "verified" : "estimated"}${change.value ? `; ${mm(Math.abs(change.value.by), d + 1)} mm ${change.value.by < 0 ? "less" : "more"} than before` : ""}` : ""}</p>
    </section>
  );
}

const interval = (ends: readonly (number | null)[], d: number) => (ends[1] === null ? `${mm(ends[0], d)}, no upper end known` : `${mm(ends[0], d)} to ${mm(ends[1], d)}`);

/** What is done about the verdict, what to do next, and how far it is. */
function Acts() {
  const run = runs.value[0], ready = Boolean(design.value) && !gesture.value.length && !refused.value, runs_ = run && unfinished(run);
  const own = runs.value.filter((each) => each.text === text.value && each.state === "succeeded"), reported = own.find((each) => each.kind === "report" && each.report);
  const unstated = !design.value?.optimise && !design.value?.requirements?.length;
  return (
    <div class="acts" role="group" aria-label="What to do">
      {!verified.value && <button type="button" aria-label="Verify this design" disabled={!ready || runs_} title="simulate many shots, each with its own installation and noise, and make the report" onClick={verify}>Verify</button>}
      <button type="button" aria-label="Optimise this design" disabled={!ready || runs_ || unstated} title={unstated ? "the design states no requirement: add one under all fields" : design.value?.optimise ? "as the design states under optimise" : START} onClick={optimise}>Optimise</button>
      {reported
        ? <ReportLink path={reported.report!} form="html" words="Report" button />
        : <button type="button" aria-label="Report of this design" disabled={!ready || runs_} title="budget, requirements and slack as a document; with a simulation where the design is verified" onClick={() => (verified.value ? verify() : start("Report", "/v1/reports", { parts: ["score"] }))}>Report</button>}
      {ready && !runs_ && <Next />}
      {run && (runs_ || run.text === text.value) && (
        <button type="button" class="small quiet" onClick={() => document.querySelector(".runs")?.scrollIntoView({ block: "center" })}>
          {runs_ ? `${run.title}: ${percent(run.fraction, 0)}${run.eta !== null ? `, about ${duration(run.eta)} left` : ""}` : `${run.title}: ${run.state === "succeeded" ? "done" : run.state}`}
        </button>
      )}
    </div>
  );
}

/** What to do next, with what it would come to. */
function Next() {
  const score = answer.value?.score, verdict = verified.value?.verdict ?? score?.verdict;
  const optimum = runs.value.map((run) => run.kind === "optimisation" && run.text === text.value && run.result ? results.value[run.result] : null).find((result) => result?.design);
  if (!score || !current.value) return null;
  const d = optimum ? decimalsOf(optimum.certificate.verification) : decimals.value;
  if (optimum) return <button type="button" class="next" onClick={() => takeOptimum(optimum)}>{`Take the optimum: ${optimum.cost_before != null && optimum.cost_after != null && optimum.cost_before !== optimum.cost_after ? `cost ${brief(optimum.cost_before)} → ${brief(optimum.cost_after)}, ` : ""}P95 ${mm(optimum.p95_before_mm, d)} → ${mm(optimum.p95_after_mm, d)} mm`}</button>;
  if (!verdict || !["fail", "inconclusive", "pass"].includes(verdict.status)) return null;
  if (verdict.status !== "fail") return verified.value ? null : <button type="button" class="next" onClick={verify}>{verdict.status === "pass" ? "Next: verify that it passes" : "Next: verify, the estimate cannot say"}</button>;
  const found = advice.value?.design === design.value ? advice.value : null;
  return found && <button type="button" class="next" onClick={() => edit(found.paths.map((path) => ({ path, value: found.value })), `Tighten ${found.words}`)}>{`Tighten ${found.words} → ${mm(found.found, d)} mm${found.passes ? ", pass" : ""}`}</button>;
}

/** Back and on again: the last states, undo and redo. */
function History() {
  const undoes = canUndo.value ? `Undo: ${steps.value[position.value].what}` : "Undo", redoes = canRedo.value ? `Redo: ${steps.value[position.value + 1].what}` : "Redo";
  return (
    <div class="history" role="group" aria-label="History">
      <Trail />
      <button type="button" aria-label={undoes} disabled={!canUndo.value} onClick={undo} title={`${undoes} (Ctrl+Z)`}>Undo</button>
      <button type="button" aria-label={redoes} disabled={!canRedo.value} onClick={redo} title={`${redoes} (Ctrl+Shift+Z)`}>Redo</button>
    </div>
  );
}

/** What the last states came to, by estimate; a press goes back to one. */
function Trail() {
  const first = Math.max(0, steps.value.length - 16);
  const known = steps.value.slice(first).flatMap((step, k) => {
    const value = seen.value.get(step.text)?.value;
    return value === undefined ? [] : [{ step, at: first + k, value }];
  });
  if (known.length < 2) return null;
  const values = known.map(({ value }) => value), low = Math.min(...values), high = Math.max(...values), wide = 14 * known.length;
  const x = (k: number) => 14 * k + 7, y = (value: number) => 28 - (22 * (value - low)) / Math.max(high - low, 1e-9);
  return (
    <svg class="trail" viewBox={`0 0 ${wide} 34`} width={wide} height="34" role="img" aria-label={`The last states, mm: ${values.map((value) => mm(value, decimals.value + 1)).join(", ")}; undo and redo go through them`}>
      <path d={known.map(({ value }, k) => `${k ? "L" : "M"}${x(k)} ${y(value)}`).join("")} />
      {known.map(({ step, at, value }, k) => (
        <g key={at} class={at === position.value ? "state now" : "state"} data-step={at} onClick={() => goTo(at)}>
          <title>{`${step.what}: ${mm(value, decimals.value + 1)} mm${at === position.value ? "" : "; press to go there"}`}</title>
          <rect x={x(k) - 7} y="0" width="14" height="34" /><circle cx={x(k)} cy={y(value)} r={at === position.value ? 4 : 3} />
        </g>
      ))}
    </svg>
  );
}

const TRIALS = 4_194_304; // that a check to a precision may draw, unless the operator allows fewer

export async function verify(): Promise<void> {
  const about = await send("GET", "/version").then((response) => response.json()).catch(() => ({})), most = Math.min(about.max_trials ?? TRIALS, TRIALS);
  await start("Verification and report", "/v1/reports", { precision: 0.005, ...(most < TRIALS ? { max_trials: most } : {}) });
}
export const optimise = () => design.value?.optimise
  ? start("Optimisation", "/v1/optimisations", {})
  : start(`Optimisation ${START}`, "/v1/optimisations", { design: { ...design.value, optimise: startOf(design.value, answer.value?.score ?? null) } });

const STATED = ["requirement-failed", "requirement-inconclusive"]; // the numbers and the rows of requirements say it

function Findings({ score }: { score: Score }) {
  const simulated = verified.value, verdict: Score["verdict"] = simulated?.verdict ?? score.verdict, checks = verdict.checks;
  const asked = new Set(checks.map((check) => check.requirement)), worst = decisive(checks);
  const kept = [...asked].filter((name) => checks.every((check) => check.requirement !== name || check.status === "pass")).length;
  const [first, ...more] = verdict.findings.filter(({ rule }) => !STATED.includes(rule)).map(({ message }) => <p key={message}>{message}</p>);
  return (
    <>
      {worst ? (
        <p class="stated">
          {`${asked.size === 1 ? "" : `${kept} of ${asked.size} requirements kept; what decides is `}${worst.requirement}${checks.length === 1 ? "" : ` at ${worst.target}`}: `}
          {worst.status === "pass" ? "within the limit." : worst.status === "fail" ? "beyond the limit." : simulated ? "too close to say, even by this simulation." : "too close to say by estimate: verify."}
        </p>
      ) : <p class="stated">The design states no requirement: nothing is judged.</p>}
      {first}
      {more.length > 0 && <details><summary>{more.length === 1 ? "1 more remark" : `${more.length} more remarks`}</summary>{more}</details>}
      <p class="note" title={simulated ? simulated.stopping : score.validity.statement}>
        {simulated ? `Verified: ${simulated.trials.toLocaleString("en")} simulated shots, each with its own installation and noise.` : trust(score.validity)}
      </p>
    </>
  );
}

/** What becomes of each requirement when one fiducial or two are not found; not looked for while something is moved. */
function Losses({ score }: { score: Score }) {
  const last = useRef<Score["losses"]>([]), shown = score.losses.length ? score.losses : last.current;
  useEffect(() => void (last.current = shown), [shown]);
  if (!shown.length) return null;
  const words = (loss: Score["losses"][number]["single"] | null) =>
    loss === null ? "too many pairs to try" : `${loss.lost.join(" and ")}: ${loss.value_mm === null ? loss.reason : `${mm(loss.value_mm, decimals.value)} mm`}`;
  const mixed = shown.some(({ mixture }) => mixture); // the design says how often fiducials are missed
  const verdict = (loss: { value_mm: number | null } | null, limit: number | null) =>
    loss === null || limit === null ? "" : loss.value_mm !== null && loss.value_mm <= limit ? "status pass" : "status fail";
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label="Lost fiducials">
      <table class={score.losses.length ? "" : "old"}>
        <caption>If fiducials are not found: the worst of all losses</caption>
        <thead><tr><th>Requirement</th><th class="number">With all, mm</th><th>Without one</th><th>Without two</th>{mixed && <th>Missed as often as stated</th>}</tr></thead>
        <tbody>
          {shown.map((loss) => (
            <tr key={loss.requirement}>
              <th>{loss.requirement || "P95 at the tool"}</th><td class="number">{mm(loss.value_mm, decimals.value)}</td>
              <td class={verdict(loss.single, loss.limit_mm)}>{words(loss.single)}</td><td class={verdict(loss.double, loss.limit_mm)}>{words(loss.double)}</td>
              {loss.mixture && (
                <td class={verdict(loss.mixture, loss.limit_mm)}>
                  {loss.mixture.value_mm === null ? "no bound: too many shots have no answer" : `${percent(loss.mixture.quantile)} of all shots: ${mm(loss.mixture.value_mm, decimals.value)} mm`}
                </td>
              )}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Every requirement at every target, as they were judged. */
export function Checks({ of, label }: { of: Pick<Score, "targets"> & { verdict: { checks: readonly Check[] } }; label: string }) {
  const checks = of.verdict.checks, d = decimalsOf(of);
  if (!checks.length) return <p class="note">The design states no requirement; add one under all fields.</p>;
  const units = checks.some((check) => check.yield_fraction !== null);
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={label}>
      <table class="checks">
        <thead><tr><th><Term word="requirement">Requirement</Term></th><th>Status</th><th class="number">Found, mm</th><th class="number">Between, mm</th><th class="number">Limit, mm</th>{units && <th class="number">Units within it (asked for)</th>}</tr></thead>
        <tbody>
          {checks.slice(0, 400).map((check) => (
            <tr key={check.requirement + check.target}>
              <th>{`${check.requirement} at ${check.target}`}<span class="note">{`${check.headline}${check.error === "tcp" ? "" : " as located"}; ${check.risk === "pooled" ? "pooled: all units and shots together" : "per unit: each by itself"}`}</span></th>
              <td class={`status ${check.status}`}>{VERDICTS[check.status] ?? check.status}</td>
              <td class="number">{mm(check.value_mm, d)}</td><td class="number">{interval(check.interval_mm, d)}</td><td class="number">{stated(check.limit_mm, d)}</td>
              {units && <td class="number">{check.yield_fraction === null ? "–" : `${percent(check.yield_fraction)} (${percent(check.min_yield)})`}</td>}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Every requirement at every target, both readings of the risk, and what lost fiducials do. */
export function Requirements() {
  const score = answer.value?.score, simulated = verified.value;
  if (!score) return <p class="note">{refused.value ? "No requirement could be judged: see above." : "The requirements are listed with the first score."}</p>;
  return (
    <div class={late.value || refused.value ? "old" : ""}>
      {simulated && <p class="note">{`As verified by ${simulated.trials.toLocaleString("en")} simulated shots; the tables below are estimates.`}</p>}
      <Checks of={simulated ?? score} label="Table of requirements" />
      <div class="scroll" tabIndex={0} role="region" aria-label="Pooled and per unit">
        <table>
          <caption>Two readings of the risk at the tool</caption>
          <thead><tr><th>Target</th><th class="number"><Term word="pooled">Pooled</Term>: 95 % of all <Term word="shot">shots</Term> within, mm</th><th class="number"><Term word="per-unit">Per unit</Term>: P95 that 95 % of <Term word="unit">units</Term> keep, mm</th><th class="number">Units whose own quantile keeps the limit</th></tr></thead>
          <tbody>
            {score.targets.slice(0, 50).map((target) => (
              <tr key={target.name}><th>{target.name}</th><td class="number">{mm(target.p95_mm, decimals.value)}</td><td class="number">{mm(target.per_unit.p95_of_units_mm, decimals.value)}</td><td class="number">{percent(target.per_unit.yield_fraction)}</td></tr>
            ))}
          </tbody>
        </table>
      </div>
      <Losses score={score} />
    </div>
  );
}
