// The API documentation, drawn from the schema that the service serves. Its calls go to the folder of the schema, which
// a proxy may have put under a prefix.
const docs = document.getElementById("docs");
const address = new URL(docs.dataset.schema, document.baseURI);
const spec = await (await fetch(address)).json();
const folder = new URL(".", address).pathname.slice(0, -1);
if (folder) spec.servers = [{ url: folder }];
globalThis.SwaggerUIBundle({ domNode: docs, spec, validatorUrl: null });
