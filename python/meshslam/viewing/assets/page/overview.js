// The map from above alone, on a page over several runs.
const startOverview = () => {
  const run = readRun(JSON.parse(byName("plan-data").textContent));
  makePlan(run, makeState({ frame: 0, object: null, colouring: "id" }), byName("map"));
  byName("map-legend").replaceChildren(...mapLegend(run));
  document.documentElement.dataset.ready = "1";
};
startOverview();
