// The API documentation, drawn from the schema that the service serves.
const docs = document.getElementById("docs");
globalThis.SwaggerUIBundle({ domNode: docs, url: docs.dataset.schema, validatorUrl: null });
