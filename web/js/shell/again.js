/**
 * A module that could not be fetched leaves an empty page: a network that just changed, a service that is started anew. Then the page
 * is loaded again, each time after a longer while. A classic script in the head, as it must be there before the modules are.
 */

(() => {
  const KEY = "rayfarm.again";
  const WAITS_MS = [300, 1000, 3000, 10_000];
  let isFailed = false;

  /** @param {number | null} times null: forget it @returns {number} how often it was tried before */
  function tried(times) {
    try {
      const before = Number(sessionStorage.getItem(KEY) ?? 0);
      if (times === null) sessionStorage.removeItem(KEY);
      else sessionStorage.setItem(KEY, String(before + times));
      return before;
    } catch {
      return WAITS_MS.length; // storage is blocked: it would be tried for ever
    }
  }

  /** @returns {boolean} whether the page will be loaded again by itself */
  function loadAgain() {
    if (isFailed) return true;
    const wait = WAITS_MS[tried(1)];
    if (wait === undefined) return false;
    isFailed = true;
    setTimeout(() => location.reload(), wait);
    return true;
  }

  addEventListener(
    "error",
    ({ target }) => {
      const isModule = target instanceof HTMLScriptElement && target.type === "module";
      const isSheet = target instanceof HTMLLinkElement && target.rel === "stylesheet";
      if (!isModule && !isSheet) return;
      if (!loadAgain() && isModule)
        (document.getElementById("main") ?? document.body).textContent = "The page could not be loaded. Is the service running? Reload the page to try again.";
    },
    true, // such an event does not bubble
  );

  Object.assign(window, {
    rayfarmAgain: {
      loadAgain,
      /** The page stands. */
      stands: () => isFailed || tried(null),
    },
  });
})();
