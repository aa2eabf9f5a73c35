/* Begins a thread of the page: the page sends its code first, and the name of the function that begins. */
self.onmessage = ({ data }) => {
  const [module, start] = data;
  wasm_bindgen.initSync({ module });
  wasm_bindgen[start]();
};
