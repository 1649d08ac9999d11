// Shows the OpenAPI document of this very service: whatever host it names, requests go where the page came from,
// below the path that a proxy may have put before it.
const here = new URL(".", location.href).href.replace(/\/$/, "");
const dark = matchMedia("(prefers-color-scheme: dark)");
const shade = () => document.documentElement.classList.toggle("dark-mode", dark.matches);
dark.addEventListener("change", shade);
shade();

fetch(`${here}/openapi.json`).then((answer) => answer.json()).then((document) => {
  SwaggerUIBundle({
    spec: { ...document, servers: [{ url: here, description: "this service" }] },
    dom_id: "#operations",
    deepLinking: true,
    defaultModelsExpandDepth: 0,
    displayRequestDuration: true,
    docExpansion: "list",
    filter: true,
    validatorUrl: null,
    // Options of a JSON body stand in it: the query is for bodies of YAML, and is refused beside JSON
    requestInterceptor: (request) => {
      if (request.headers["Content-Type"] === "application/json") request.url = request.url.split("?")[0];
      return request;
    },
  });
});
