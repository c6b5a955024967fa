// A page whose scripts did not all come does nothing, so it is loaded again. This one is no module:
// it has to run where a module is missing.

const AGAIN_MS = 1000;

addEventListener(
  "error",
  ({ target }) => {
    if (target instanceof HTMLScriptElement) setTimeout(() => location.reload(), AGAIN_MS);
  },
  true, // what did not come is told to its element alone
);
