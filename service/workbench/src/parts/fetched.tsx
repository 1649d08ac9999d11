// Parts of the page that are fetched when they are first shown: the first score does not wait for them.

import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { say } from "../state";

/** A part that is fetched when it is first shown. */
export function fetched<P = object>(name: string, load: () => Promise<preact.ComponentType<P>>): preact.ComponentType<P> {
  const loaded = signal<preact.ComponentType<P> | null>(null);
  return (given) => {
    useEffect(() => {
      if (!loaded.value) void load().then((part) => (loaded.value = part), () => say("This part of the page does not come: the service does not answer. Close the part and open it again.", true));
    }, []);
    return loaded.value ? <loaded.value {...given} /> : <p class="note">{`${name}: being fetched.`}</p>;
  };
}
