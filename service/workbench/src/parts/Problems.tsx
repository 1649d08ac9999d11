// What is wrong, in the service's words: a refusal as a whole, and what of it belongs to one part of the design.

import { answer, current, pathOf, placeInWords, type Refusal, refused } from "../api";
import { canUndo, design, shownPointer, undo, valueAt } from "../state";

const SHOWN = 6;

export function Problems({ problem, undoable = false }: { problem: Refusal; undoable?: boolean }) {
  return (
    <div class="problems" role={undoable ? undefined : "alert"}>
      <p><strong>{problem.title}</strong></p>
      <ul>
        {problem.errors.slice(0, SHOWN).map((error) => (
          <li key={error.pointer + error.detail}>
            {error.pointer && <code title={error.pointer}>{placeInWords(design.value, error.pointer)}</code>} {error.detail}
            {error.hint && <span class="note"> {error.hint}</span>}
            {error.pointer && valueAt(design.value, pathOf(error.pointer)) !== undefined && (
              <>{" "}<button type="button" class="small" onClick={() => (shownPointer.value = error.pointer)}>show in the text</button></>
            )}
          </li>
        ))}
      </ul>
      {problem.errors.length > SHOWN && <p>{`and ${problem.errors.length - SHOWN} more`}</p>}
      {undoable && canUndo.value && <p><button type="button" onClick={undo}>Undo the last change</button></p>}
    </div>
  );
}

/** What the service says of one part of the design (``at``, a pointer), beside the picture of it. */
export function Remarks({ at }: { at: string }) {
  const errors = refused.value?.errors.map((error) => ({ ...error, words: error.detail, bad: true })) ?? [];
  const findings = current.value ? answer.value!.score.verdict.findings.map((finding) => ({ ...finding, words: finding.message, bad: finding.severity === "error" })) : [];
  const here = [...errors, ...findings].filter(({ pointer }) => pointer === at || pointer.startsWith(`${at}/`));
  return <>{here.slice(0, SHOWN).map(({ words, bad }) => <p key={words} class={bad ? "remark bad" : "remark"}>{words}</p>)}</>;
}
