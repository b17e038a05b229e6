/**
 * Reloads the page if a module could not be fetched, as after a network change or during a restart of the service, each time
 * after a longer delay. A classic script in the head, since it must run before the modules.
 */

(() => {
  const KEY = "rayfarm.again";
  const WAITS_MS = [300, 1000, 3000, 10_000];
  let isFailed = false;

  /** @param {number | null} times null: clears the count @returns {number} previous number of attempts */
  function tried(times) {
    try {
      const before = Number(sessionStorage.getItem(KEY) ?? 0);
      if (times === null) sessionStorage.removeItem(KEY);
      else sessionStorage.setItem(KEY, String(before + times));
      return before;
    } catch {
      return WAITS_MS.length; // storage is blocked, so the attempts could not be counted
    }
  }

  /** @returns {boolean} whether the page will be reloaded */
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
    true, // this event does not bubble
  );

  Object.assign(window, {
    rayfarmAgain: {
      loadAgain,
      /** Records that the page was loaded successfully. */
      viewShown: () => isFailed || tried(null),
    },
  });
})();
