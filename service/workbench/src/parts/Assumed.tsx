// What the verdict rests on that nobody stated: how many values, beside the verdict, and the list to work off.

import { computed, signal } from "@preact/signals";
import { pathOf, placeInWords } from "../api";
import { confirming, listAssumed } from "../assumed";
import { design, edit, settled, shownPointer, valueAt } from "../state";
import { Table } from "./Words";

const assumed = computed(() => listAssumed(settled.value));
export const wanted = signal(false); // the list is to be shown

/** "on 22 assumed values", beside the verdict; a press shows which. */
export function Rests() {
  const count = assumed.value.length;
  if (!count) return null;
  return <button type="button" class="small rests" title="values that nobody stated: which, and where to state them" onClick={() => {
    wanted.value = true;
    window.setTimeout(() => document.querySelector(".assumed")?.scrollIntoView({ block: "center" }));
  }}>{`on ${count} assumed value${count === 1 ? "" : "s"}`}</button>;
}

const shown = (value: unknown) => (Array.isArray(value) ? value.flat().join(", ") : String(value));

export function Assumed() {
  if (!assumed.value.length) return <p class="note">Every value of this design was stated.</p>;
  return (
    <div class="assumed">
      <p class="note">Nobody stated these values; the verdict holds as far as they do. A change takes a value off the list, and so does a word that it is so.</p>
      <Table name="Values that nobody stated" head={<><th>Value</th><th class="number">As assumed</th><th><span class="hidden">State it</span></th></>}>
        {assumed.value.map((pointer) => {
          const words = placeInWords(design.value, pointer);
          return (
            <tr key={pointer}>
              <th><button type="button" class="small quiet link" title={pointer} aria-label={`Show ${words} in the text`} onClick={() => (shownPointer.value = pointer)}>{words}</button></th>
              <td class="number">{shown(valueAt(settled.value, pathOf(pointer)))}</td>
              <td><button type="button" class="small" aria-label={`It is so: ${words}`} onClick={() => edit(confirming(settled.value, pointer), `State ${words}`)}>It is so</button></td>
            </tr>
          );
        })}
      </Table>
    </div>
  );
}

/** Whether there is a list to show. */
export const anyAssumed = computed(() => assumed.value.length > 0);
