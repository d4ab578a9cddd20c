CREATE TABLE objects (
	seq BIGSERIAL NOT NULL,
	id VARCHAR(64) NOT NULL,
	kind VARCHAR(16) NOT NULL,
	created_at TIMESTAMP WITH TIME ZONE NOT NULL,
	model TEXT NOT NULL,
	spec TEXT NOT NULL,
	members TEXT NOT NULL,
	theta BYTEA,
	PRIMARY KEY (seq),
	UNIQUE (id)
);
CREATE TABLE uses (
	composed_id VARCHAR(64) NOT NULL,
	member_id VARCHAR(64) NOT NULL,
	PRIMARY KEY (composed_id, member_id),
	FOREIGN KEY(composed_id) REFERENCES objects (id) ON DELETE CASCADE,
	FOREIGN KEY(member_id) REFERENCES objects (id) ON DELETE RESTRICT
);
CREATE INDEX uses_member_id ON uses (member_id);
INSERT INTO objects VALUES(1,'9ae47e445bac264c2961641fba584968','imported','2026-01-02 03:04:05.678901+00','tiny-k2','{"activation":"relu","domain":"ball","hidden":[2],"input_dim":3,"k":2,"name":"tiny","output_dim":3}','','\x14a65f3c9828053f0e60d2be4d9f043f357e5ebed551b5bd6ebdc13e72bad6bd7fa38f3db80a2bbf2790b73e1ef35c3d279376be3ed8d03e8e808ebe3baf86bdb67d04bf');
INSERT INTO objects VALUES(2,'1fa301afdc696f8b221f36fb2c84968f','imported','2026-01-02 03:04:05.678901+00','tiny-k2','{"activation":"relu","domain":"ball","hidden":[2],"input_dim":3,"k":2,"name":"tiny","output_dim":3}','','\xbeef8cbe4b446ebeb9c5b93e1443f1be6cb8ec3d6320873ed583b8be098003bf88f0a2bec4fc633e3357b43dca61fdbe401fc3bd2e2b753eb5a3dfbd22df403eda3a293f');
INSERT INTO objects VALUES(4,'3113377aa78d1bb106f219b8656f9cce','composed','2026-01-02 03:04:05.678901+00','tiny-k2','{"activation":"relu","domain":"ball","hidden":[2],"input_dim":3,"k":2,"name":"tiny","output_dim":3}','9ae47e445bac264c2961641fba584968 1fa301afdc696f8b221f36fb2c84968f',NULL);
INSERT INTO objects VALUES(5,'d02dcb09a0b5bc1d08897c23008f05b8','interpolated','2026-01-02 03:04:05.678901+00','tiny-k2','{"activation":"relu","domain":"ball","hidden":[2],"input_dim":3,"k":2,"name":"tiny","output_dim":3}','9ae47e445bac264c2961641fba584968 1fa301afdc696f8b221f36fb2c84968f','\x8df205be0a2f133ea8d2c4bc30dcbf3cfe4350bddc97b33d9099133c57579ebe500ffebd0e1764bef4a5643e66c361be64112cbeeab6a53e7b6946be090f7b3d90f4923d');
INSERT INTO uses VALUES('3113377aa78d1bb106f219b8656f9cce','9ae47e445bac264c2961641fba584968');
INSERT INTO uses VALUES('3113377aa78d1bb106f219b8656f9cce','1fa301afdc696f8b221f36fb2c84968f');
SELECT setval('objects_seq_seq', 5);
