CREATE TABLE scenes (
    id VARCHAR(40) NOT NULL,
    name VARCHAR(255) NOT NULL,
    status VARCHAR(16) NOT NULL,
    error TEXT,
    created FLOAT NOT NULL,
    main TEXT NOT NULL,
    environment TEXT,
    files JSON NOT NULL,
    bytes BIGINT NOT NULL,
    notes JSON NOT NULL,
    info JSON,
    compiled JSON NOT NULL,
    PRIMARY KEY (id)
);
CREATE INDEX ix_scenes_status ON scenes (status);
CREATE INDEX ix_scenes_created ON scenes (created);
CREATE TABLE jobs (
    id VARCHAR(40) NOT NULL,
    scene VARCHAR(40) NOT NULL,
    name VARCHAR(255) NOT NULL,
    state VARCHAR(16) NOT NULL,
    priority INTEGER NOT NULL,
    created FLOAT NOT NULL,
    started FLOAT,
    finished FLOAT,
    active_s FLOAT NOT NULL,
    request JSON NOT NULL,
    settings JSON,
    tile_size INTEGER,
    spp INTEGER,
    noise FLOAT,
    seconds FLOAT,
    kind VARCHAR(128),
    error TEXT,
    reproduce TEXT,
    idempotency_key VARCHAR(255),
    PRIMARY KEY (id),
    UNIQUE (idempotency_key)
);
CREATE INDEX ix_jobs_created ON jobs (created);
CREATE INDEX ix_jobs_scene ON jobs (scene);
CREATE INDEX ix_jobs_state ON jobs (state);
CREATE TABLE frames (
    job VARCHAR(40) NOT NULL,
    number INTEGER NOT NULL,
    samples BIGINT NOT NULL,
    target BIGINT NOT NULL,
    bad_samples BIGINT NOT NULL,
    progress FLOAT NOT NULL,
    PRIMARY KEY (job, number),
    FOREIGN KEY(job) REFERENCES jobs (id) ON DELETE CASCADE
);
CREATE INDEX frames_of_job ON frames (job);
