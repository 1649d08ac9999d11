// What the numbers say, in a strip that is always in sight.

import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { onSurface, optimise, takeAdvice, takeOptimum, verify } from "../acts";
import { advised, START } from "../advice";
import { best, mayBound } from "../best";
import { answer, busy, current, late, refused, type Score, send, trouble, turnTable } from "../api";
import { loadResult, outOfReach, results, runs, start, stateWords, unfinished } from "../jobs";
import { type AnyReading, BY, change, type Check, decimals, decisive, estimated, seen, shown, standing, verified } from "../readings";
import { canRedo, canUndo, design, edit, gesture, goTo, position, redo, steps, text, undo } from "../state";
import { brief, changed, decimalsOf, duration, levelOf, mm, percent, sign, stated, told, VERDICTS } from "../words";
import { Rests } from "./Assumed";
import { Checks, interval, limitWords, Measures } from "./Checks";
import { NumberField } from "./Controls";
import { Dots } from "./Dots";
import { Reach } from "./Levers";
import { barred, Keep, Limit, limitOf, Pulled } from "./Limit";
import { Problems } from "./Problems";
import { handOver, ReportLink } from "./Reports";
import { Fold, Table, Term } from "./Words";

const warming = signal(false); // the service says that it is not ready yet
const PATIENCE = 700; // ms without a first score, after which the page asks why

export function Verdict() {
  const reading = shown.value, problem = refused.value, old = late.value || (problem !== null && !current.value), worst = reading?.decides, d = reading?.digits ?? 3, unit = reading?.unit ?? "mm";
  const waits = !reading && (problem === null || problem.errors.some(({ rule }) => rule === "warming-up"));
  const status = waits ? "waiting" : problem ? "refused" : reading?.record.verdict.status ?? "waiting", word = VERDICTS[status] ?? status;
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
  const shade = old ? "old" : "", now = change.value, own = reading && (reading.joined ?? { known: Math.hypot(...reading.target.bias_mm), mean: reading.target.mean_norm_mm }), limit = worst && limitOf(design.value, worst.requirement);
  return (
    <section id="verdict" tabIndex={-1} class={`verdict steady ${old && !problem ? "waiting" : status.replace(" ", "-")}`} aria-label="Verdict" data-current={String(current.value && !problem)} data-basis={reading?.kind ?? "estimate"}>
      <div class="head">
        <p class={`badge ${old && !problem ? "old" : ""}`}>
          {waits ? (warming.value ? "Warming up" : "…") : problem ? "No answer" : word}
          {reading && !problem && <Rests />}
          {reading && !problem && <span class="basis"><Term word={reading.kind === "simulation" ? "verification" : "estimate"} quiet>{BY[reading.kind]}</Term></span>}
        </p>
        {reading && own && (
          <dl class={`numbers ${shade}`} data-testid="numbers" data-kind={reading.kind}>
            <div>
              <dt title={`${reading.headline} ${reading.of}`}><Term word={reading.headline === "P95" ? "P95" : "requirement"} quiet>{reading.headline}</Term>{` ${reading.of}`}</dt>
              <dd>
                {now && <span class="was">{`${mm(now.from, now.decimals)} → `}</span>}
                <output id="p95" aria-live="off">{mm(reading.value, now?.decimals ?? d)}</output>{sign(unit)}
                {now && <span class={now.to < now.from ? "delta less" : "delta more"}>{` (${changed(now.to - now.from, now.decimals)})`}</span>}
              </dd>
            </div>
            {worst && <div><dt>Between</dt><dd>{interval(worst.interval, d)}</dd></div>}
            {worst && <div><dt><Term word="limit" quiet>Limit</Term></dt><dd>{limit ? <NumberField path={limit} label={`limit of ${worst.requirement}`} unit={worst.unit} hidden /> : stated(worst.limit, d)}{sign(worst.unit)}</dd></div>}
            {worst?.yield_fraction != null && <div><dt class="level">{`${levelOf(worst.risk)}s that meet it`}</dt><dd>{percent(worst.yield_fraction)}{worst.min_yield != null && <span class="was">{` of ${percent(worst.min_yield)} asked for`}</span>}</dd></div>}
            <div class={isBiased(reading) ? "leads" : ""}><dt><Term word="bias" quiet>{reading.kind === "simulation" ? "Bias" : "Known bias"}</Term></dt><dd>{told(own.known, d, unit)}</dd></div>
            <div><dt>Mean error</dt><dd>{told(own.mean, d, unit)}</dd></div>
          </dl>
        )}
      </div>
      {estimated.value?.record.fifty_shots && !problem && <Dots rows={[{ name: "", shots: estimated.value.record.fifty_shots }]} old={old || !standing.value.holds} />}
      <Acts />
      <div class="judged">
      {reading && !problem && <Limit />}
      <div class="sentence">
        {!barred.value && <Pulled />}
        {waits && <p>{warming.value ? "The service is warming up: it loads what it computes with. The first score comes by itself." : "The first score is being computed."}</p>}
        {!waits && trouble.value && <Problems problem={trouble.value} undoable={problem !== null && problem.status !== 0} />}
        {!waits && !trouble.value && reading && <div class={`findings ${shade}`} data-kind={reading.kind}><Findings reading={reading} /></div>}
      </div>
      </div>
      <p class="hidden" role="status">{busy.value ? "" : problem ? problem.title : reading ? `${reading.headline} ${mm(reading.value, d)}${sign(unit)}, ${word}, ${BY[reading.kind]}${now ? `; ${mm(Math.abs(now.to - now.from), now.decimals)}${sign(unit)} ${now.to < now.from ? "less" : "more"} than before` : ""}` : ""}</p>
    </section>
  );
}

/** What decides each of the other requirements, the most urgent first: degrees beside millimetres.  One line of them; pressed, one line each. */
function Others({ of: { record, decides } }: { of: AnyReading }) {
  const all: Check[] = [];
  for (let left = record.verdict.checks.filter((check) => check.requirement !== decides?.requirement), next = decisive(left); next; next = decisive(left)) {
    all.push(next);
    left = left.filter((check) => check.requirement !== next!.requirement);
  }
  return all.length > 0 && (
    <details class="others" key={decides?.requirement}><summary>
      {all.map(({ requirement, target, value, limit, unit, status, headline, words }) => <span key={requirement} title={`${headline} of ${words}`}>{`${requirement}, ${target}: `}<em>{`${headline} of ${words} `}</em><strong class={`status ${status}`}>{`${told(value, decimalsOf(record as Score, unit), unit)} of ${limitWords(limit, decimalsOf(record as Score, unit), unit)}`}</strong>{" "}</span>)}
    </summary></details>
  );
}

/** Whether what is known and the same each time is most of the error: it is taken away before any tolerance. */
const isBiased = ({ joined, target: { bias_mm, std_mm } }: AnyReading) => !joined && Math.hypot(...bias_mm) > Math.hypot(...std_mm);

/** What is done about the verdict, what to do next, and how far it is. */
function Acts() {
  const run = runs.value[0], ready = Boolean(design.value) && !gesture.value.length && !refused.value, runs_ = run && unfinished(run);
  const own = runs.value.filter((each) => each.text === text.value && each.state === "succeeded"), reported = own.find((each) => each.kind === "report" && each.report);
  const unstated = !design.value?.optimise && !design.value?.requirements?.length;
  return (
    <div class="acts" role="group" aria-label="What to do">
      {!verified.value && <button type="button" aria-label="Verify this design" disabled={!ready || runs_} title="simulate many shots, each with its own installation and noise, and make the report" onClick={verify}>Verify</button>}
      <button type="button" aria-label="Optimise this design" disabled={!ready || runs_ || unstated} title={unstated ? "the design states no requirement: add one under all fields" : onSurface.value ? `with beads on ${onSurface.value.file}` : design.value?.optimise ? "as the design states under optimise" : START} onClick={optimise}>Optimise</button>
      {reported
        ? <ReportLink path={reported.report!} form="html" words="Report" button />
        : <button type="button" aria-label="Report of this design" disabled={!ready || runs_} title="budget, requirements and slack as a document; with a simulation where the design is verified" onClick={() => (verified.value ? verify() : start("Report", "/v1/reports", { parts: ["score"] }))}>Report</button>}
      {shown.value && !refused.value && <Keep />}
      {ready && !runs_ && <Next />}
      {run && (runs_ || run.text === text.value) && (
        <button type="button" class="small quiet" onClick={() => document.querySelector(".runs")?.scrollIntoView({ block: "center" })}>
          {runs_ ? `${run.title}: ${percent(run.fraction, 0)}${run.eta !== null ? `, about ${duration(run.eta)} left` : ""}` : `${run.title}: ${run.state === "succeeded" ? "done" : stateWords(run)}`}
        </button>
      )}
      {mayBound.value && shown.value && <span class={`note ${late.value ? "old" : ""}`} data-kind="estimate" data-testid="best" title={best.value?.whole}>{best.value?.words ?? ""}</span>}
    </div>
  );
}

/** What to do next, with what it would come to. */
function Next() {
  const reading = shown.value, verdict = reading?.record.verdict, step = advised.value?.step;
  const optimum = runs.value.map((run) => run.kind === "optimisation" && run.text === text.value && run.result ? results.value[run.result] : null).find((result) => result?.design);
  if (!reading || !current.value) return null;
  const d = optimum ? decimalsOf(optimum.certificate.verification) : decimals.value;
  if (optimum) return <button type="button" class="next" data-kind="estimate" onClick={() => takeOptimum(optimum)}>{`Take the optimum: ${optimum.cost_before != null && optimum.cost_after != null && optimum.cost_before !== optimum.cost_after ? `cost ${brief(optimum.cost_before)} → ${brief(optimum.cost_after)}, ` : ""}P95 ${mm(optimum.p95_before_mm, d)} → ${mm(optimum.p95_after_mm, d)} mm by estimate`}</button>;
  if (!verdict || !["fail", "inconclusive", "pass"].includes(verdict.status)) return null;
  if (verdict.status === "pass" && verified.value) return <button type="button" class="next" onClick={() => handOver("pdf")}>Next: the sheet for the supplier</button>;
  if (verdict.status !== "fail") return verified.value ? null : <button type="button" class="next" onClick={verify}>{verdict.status === "pass" ? "Next: verify that it passes" : "Next: verify, the estimate cannot say"}</button>;
  if (!verified.value && !standing.value.holds) return <button type="button" class="next" onClick={verify}>Next: verify, the estimate does not hold</button>;
  return step && <button type="button" class="next" data-kind="estimate" onClick={takeAdvice}>{`Tighten ${step.words} → ${mm(step.found, advised.value!.digits)} ${advised.value!.unit} by estimate${step.passes ? ", pass" : ""}`}</button>;
}

/** Back and on again: to the first page, the last states, undo and redo. */
export function History() {
  const undoes = canUndo.value ? `Undo: ${steps.value[position.value].what}` : "Undo", redoes = canRedo.value ? `Redo: ${steps.value[position.value + 1].what}` : "Redo";
  return (
    <div class="history" role="group" aria-label="History">
      <Trail />
      <a class="button" href="#start" title="examples, your own beads, or a file; this design stays">First page</a>
      <button type="button" aria-label={undoes} disabled={!canUndo.value} onClick={undo} title={`${undoes} (Ctrl+Z)`}>Undo</button>
      <button type="button" aria-label={redoes} disabled={!canRedo.value} onClick={redo} title={`${redoes} (Ctrl+Shift+Z)`}>Redo</button>
    </div>
  );
}

/** What the last states came to, by estimate; a press goes back to one. */
function Trail() {
  const first = Math.max(0, steps.value.length - 16), { unit, digits } = estimated.value ?? { unit: "mm", digits: 3 };
  const known = steps.value.slice(first).flatMap((step, k) => {
    const reading = seen.value.get(step.text);
    return reading?.unit === unit ? [{ step, at: first + k, value: reading.value }] : [];
  });
  if (known.length < 2) return null;
  const values = known.map(({ value }) => value), low = Math.min(...values), high = Math.max(...values), wide = 14 * known.length;
  const x = (k: number) => 14 * k + 7, y = (value: number) => 28 - (22 * (value - low)) / Math.max(high - low, 1e-9);
  return (
    <svg class="trail" viewBox={`0 0 ${wide} 34`} width={wide} height="34" role="img" data-kind="estimate" aria-label={`The last states by estimate, ${unit}: ${values.map((value) => mm(value, digits + 1)).join(", ")}; undo and redo go through them`}>
      <path d={known.map(({ value }, k) => `${k ? "L" : "M"}${x(k)} ${y(value)}`).join("")} />
      {known.map(({ step, at, value }, k) => (
        <g key={at} class={at === position.value ? "state now" : "state"} data-step={at} onClick={() => goTo(at)}>
          <title>{`${step.what}: ${mm(value, digits + 1)}${sign(unit)} by estimate${at === position.value ? "" : "; press to go there"}`}</title>
          <rect x={x(k) - 7} y="0" width="14" height="34" /><circle cx={x(k)} cy={y(value)} r={at === position.value ? 4 : 3} />
        </g>
      ))}
    </svg>
  );
}

const STATED = ["requirement-failed", "requirement-inconclusive"]; // the numbers and the rows of requirements say it

function Findings({ reading }: { reading: AnyReading }) {
  const { record: { verdict }, decides: worst, kind } = reading, checks = verdict.checks, simulated = verified.value?.record;
  const asked = new Set(checks.map((check) => check.requirement)), wall = runs.value.find((run) => run.text === text.value && outOfReach(run))?.problem?.errors[0];
  const kept = [...asked].filter((name) => checks.every((check) => check.requirement !== name || check.status === "pass")).length;
  const [first, ...more] = verdict.findings.filter(({ rule }) => !STATED.includes(rule)).map(({ message }) => <p key={message}>{message}</p>);
  return (
    <>
      {worst ? (
        <p class="stated">
          {`${asked.size === 1 ? "" : `${kept} of ${asked.size} requirements kept; what decides is `}${worst.requirement}${checks.length === 1 ? "" : ` at ${worst.target}`}: `}
          {worst.status === "pass" ? "within the limit." : worst.status === "fail" ? "beyond the limit." : kind === "simulation" ? "too close to say, even by this simulation." : worst.interval[1] === null ? "open by estimate: verify." : "too close to say by estimate: verify."}
          {isBiased(reading) && !advised.value?.wall && ` A ${kind === "estimate" ? "known " : ""}bias of ${mm(Math.hypot(...reading.target.bias_mm), reading.decimals)} mm is most of it: correct for it before any tolerance.`}
        </p>
      ) : <p class="stated">The design states no requirement: nothing is judged. <button type="button" class="small" onClick={() => edit([{ path: ["requirements"], value: [{ name: "accuracy", limit_mm: 1 }] }], "State a limit")}>State a limit</button></p>}
      {wall ? <p class="wall" data-kind="estimate" title={wall.detail}>{`Out of reach, by estimate: ${wall.detail.replace(/; the limit of .* Share of the mean square there: ([^,]+),? ?.*/, "; because $1")}.`}</p> : advised.value?.wall && <p class="wall" data-kind="estimate">{advised.value.wall}</p>}
      {!wall && <Reach />}
      {first}
      {more.length > 0 && <details><summary>{more.length === 1 ? "1 more remark" : `${more.length} more remarks`}</summary>{more}</details>}
      <p class="note" title={simulated?.stopping ?? answer.value!.score.validity.statement}>
        {`${simulated ? `Verified: ${simulated.trials.toLocaleString("en")} simulated shots, each with its own installation and noise. ` : ""}${standing.value.words}`}
      </p>
      <Others of={reading} />
    </>
  );
}

/** What becomes of each requirement when one fiducial or two are not found; not looked for while something is moved. */
function Losses({ score }: { score: Score }) {
  const last = useRef<Score["losses"]>([]), shown = score.losses.length ? score.losses : last.current;
  useEffect(() => void (last.current = shown), [shown]);
  if (!shown.length) return null;
  const words = (loss: Score["losses"][number]["single"] | null, unit: string) =>
    loss === null ? "too many pairs to try" : `${loss.lost.join(" and ")}: ${loss.value === null ? loss.reason : `${mm(loss.value, decimals.value)}${sign(unit)}`}`;
  const mixed = shown.some(({ mixture }) => mixture); // the design says how often fiducials are missed
  const verdict = (loss: { value: number | null } | null, limit: number | null) =>
    loss === null || limit === null ? "" : loss.value !== null && loss.value <= limit ? "status pass" : "status fail";
  return (
    <Table name="Lost fiducials" look={score.losses.length ? "" : "old"} kind="estimate" caption="If fiducials are not found: the worst of all losses, by estimate" head={<><th>Requirement</th><th class="number">With all</th><th>Without one</th><th>Without two</th>{mixed && <th>Missed as often as stated</th>}</>}>
      {shown.map((loss) => (
        <tr key={loss.requirement}>
          <th>{loss.requirement || "P95 at the tool"}</th><td class="number">{`${mm(loss.value, decimals.value)} ${loss.unit}`}</td>
          <td class={verdict(loss.single, loss.limit)}>{words(loss.single, loss.unit)}</td><td class={verdict(loss.double, loss.limit)}>{words(loss.double, loss.unit)}</td>
          {loss.mixture && (
            <td class={verdict(loss.mixture, loss.limit)}>
              {loss.mixture.value === null ? "no bound: too many shots have no answer" : `${percent(loss.mixture.quantile)} of all shots: ${mm(loss.mixture.value, decimals.value)} ${loss.unit}`}
            </td>
          )}
        </tr>
      ))}
    </Table>
  );
}

const PER_UNIT = "Per unit, and if fiducials are not found";
/** Every requirement at every target, both readings of the risk, and what lost fiducials do. */
export function Requirements() {
  const score = answer.value?.score, reading = shown.value;
  if (!score || !reading) return <p class="note">{refused.value ? "No requirement could be judged: see above." : "The requirements are listed with the first score."}</p>;
  return (
    <div class={late.value || refused.value ? "old" : ""}>
      {verified.value && <p class="note">{`As verified by ${verified.value.record.trials.toLocaleString("en")} simulated shots; the tables below are estimates${standing.value.holds ? "" : ", and do not hold here"}.`}</p>}
      <Checks of={reading} label="Table of requirements" />
      <div class={standing.value.holds ? "" : "outdated"}>
      {estimated.value && <Measures of={estimated.value} />}
      <Fold words={PER_UNIT} turned={(open) => turnTable(PER_UNIT, open)}>
      <Table name="Pooled and per unit" kind="estimate" caption="Two readings of the risk at the tool, by estimate" head={<><th>Target</th><th class="number"><Term word="pooled">Pooled</Term>: 95 % of all <Term word="shot">shots</Term> within, mm</th><th class="number"><Term word="per-unit">Per unit</Term>: P95 that 95 % of <Term word="unit">units</Term> keep, mm</th><th class="number">Units whose own quantile keeps the limit</th></>}>
        {score.targets.slice(0, 50).map((target) => (
          <tr key={target.name}><th>{target.name}</th><td class="number">{mm(target.p95_mm, decimals.value)}</td><td class="number">{mm(target.per_unit.p95_of_units_mm, decimals.value)}</td><td class="number">{percent(target.per_unit.yield_fraction)}</td></tr>
        ))}
      </Table>
      <Losses score={score} />
      </Fold>
      </div>
    </div>
  );
}
