// The types of openapi-typescript, with one rule of ours: what is binary is a Blob. Its own calls it a string.
// node types.mjs NODE_MODULES DOCUMENT OUTPUT
import { writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const [modules, document, output] = process.argv.slice(2);
const installed = createRequire(`${modules}/`);
const { default: makeTypes, astToString, COMMENT_HEADER } = installed("openapi-typescript");
const blob = installed("typescript").factory.createTypeReferenceNode("Blob");

const tree = await makeTypes(pathToFileURL(document), {
  defaultNonNullable: false, // a field with a default may be left out of a request; answers list what they always hold
  transform: (schema) => (schema.format === "binary" ? blob : undefined),
});
writeFileSync(output, COMMENT_HEADER + astToString(tree));
