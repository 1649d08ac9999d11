// One browser for all pages of a test process: {executable, sandbox} as a line of JSON on stdin, its address as a line on
// stdout.  It ends when stdin does, so with whoever started it, however that ends.
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const FLAGS = [
  "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync",
];
const lines = createInterface({ input: process.stdin });
let server;
lines.once("line", async (line) => {
  const { executable, sandbox } = JSON.parse(line);
  server = await chromium.launchServer({ executablePath: executable, chromiumSandbox: sandbox, args: FLAGS, host: "127.0.0.1" });
  process.stdout.write(`${server.wsEndpoint()}\n`);
});
lines.once("close", async () => {
  await server?.close();
  process.exit();
});
